"""`python -m api`: the service in this process, with settings from the environment."""

from __future__ import annotations

import sys

from api.app import serve
from api.settings import SettingsError, read_settings


def main() -> int:
    """Serves until it is ended. Returns the exit status of the process."""
    try:
        settings = read_settings()
    except SettingsError as error:
        print(f"fling: {error}", file=sys.stderr)
        return 1
    return serve(settings)


if __name__ == "__main__":
    sys.exit(main())
