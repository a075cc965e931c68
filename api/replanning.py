"""The cells whose waiting throw is being planned again: one search at a time for each."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import Any


class Replanning:
    """Searches that go on by themselves, on the event loop; each ends with the service at the latest."""

    def __init__(self) -> None:
        self._tasks: dict[str, asyncio.Task[None]] = {}

    def begin(self, name: str, work: Coroutine[Any, Any, None]) -> bool:
        """Begins a search, by a name; returns whether it did: one that goes on looks at the newest by itself."""
        if name in self._tasks:
            work.close()
            return False
        task = asyncio.create_task(work)
        self._tasks[name] = task
        task.add_done_callback(lambda _: self._tasks.pop(name, None))
        return True

    async def close(self) -> None:
        """Ends all searches."""
        tasks = list(self._tasks.values())
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
