"""What goes on for waiting throws between two observations: searches, and stops in time, one of a name at a time."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class Replanning:
    """Work that goes on by itself, on the event loop; all of it ends with the service at the latest."""

    def __init__(self) -> None:
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def begin(self, name: str, work: Coroutine[Any, Any, None]) -> bool:
        """Begins work under a name; returns whether it did: what goes on looks at the newest by itself."""
        if name in self._tasks:
            work.close()
            return False
        task = asyncio.create_task(work)
        self._tasks[name] = task
        task.add_done_callback(lambda _: self._tasks.pop(name, None))
        return True

    async def close(self) -> None:
        """Ends all of it."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
