"""Writes the OpenAPI document of the service to standard output: the page's types are made from it."""

from __future__ import annotations

import json

from api.app import create_app
from api.settings import ServiceSettings

if __name__ == "__main__":
    print(json.dumps(create_app(ServiceSettings(tokens_file=None)).openapi(), indent=1, sort_keys=True))
