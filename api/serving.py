"""Running the service until a signal."""

from __future__ import annotations

import sys

from api.settings import Settings

SHUTDOWN_S = 2  # [s] open event streams are cut after this


def serve(settings: Settings) -> int:
    """Serves until SIGINT or SIGTERM. Returns the process's exit status."""
    import uvicorn

    from api.app import create_app
    from store import Store, StoreError

    try:
        Store.open(settings.database_url).close()
        app = create_app(settings)
    except (ValueError, RuntimeError, StoreError) as error:
        print(f"fling: {error}", file=sys.stderr)
        return 2
    uvicorn.run(
        app, host=settings.host, port=settings.port, log_level="warning", access_log=False, server_header=False,
        timeout_graceful_shutdown=SHUTDOWN_S,
    )  # fmt: skip
    return 0
