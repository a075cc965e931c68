"""`python -m api`: the service in this process, settings from the environment."""

from __future__ import annotations

import sys

from api.serving import serve
from api.settings import Settings

if __name__ == "__main__":
    sys.exit(serve(Settings()))
