"""`python -m api`: the service in this process, with settings from the environment."""

from __future__ import annotations

import sys

from api.app import serve
from api.settings import ServiceSettings

if __name__ == "__main__":
    sys.exit(serve(ServiceSettings()))
