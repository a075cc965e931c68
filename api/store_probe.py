"""Whether the store can be written to, for `/readyz`: probed by a write, at most once a second."""

from __future__ import annotations

import threading
import time

from store import Store, StoreUnavailable

FRESH_S = 1.0  # [s] a finding is used again for: anybody may ask, and each probe writes


class StoreProbe:
    """Probes the store of a service."""

    def __init__(self, store: Store) -> None:
        self._store, self._lock = store, threading.Lock()
        self._probed_at = float("-inf")
        self._finding: StoreUnavailable | None = None

    def outage(self) -> StoreUnavailable | None:
        """Returns why the store cannot be written to; None where it can."""
        with self._lock:
            if time.monotonic() - self._probed_at > FRESH_S:
                self._finding = self._probe()
                self._probed_at = time.monotonic()
            return self._finding

    def _probe(self) -> StoreUnavailable | None:
        try:
            self._store.check_writable()
        except StoreUnavailable as error:
            return error
        return None
