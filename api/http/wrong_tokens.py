"""Repeated wrong tokens: answers to an address that keeps guessing come later and later, and the log tells of it."""

from __future__ import annotations

import logging
import time
from collections import OrderedDict

FREE = 3  # [-] wrong tokens in a row that are answered at once: somebody copied it badly
FIRST_DELAY_S = 0.25  # [s] of the next one; it doubles with each
DELAY_MAX_S = 8.0  # [s]
FORGOTTEN_S = 60.0  # [s] without a wrong token an address begins anew
ADDRESSES_MAX = 1000  # [-] addresses that are remembered

log = logging.getLogger("fling")


class WrongTokens:
    """Wrong tokens by the address that they came from. Right ones are never delayed."""

    def __init__(self) -> None:
        self._seen: OrderedDict[str, tuple[int, float]] = OrderedDict()  # count and time of the last one [s]

    def delay_s(self, address: str) -> float:
        """Counts one more wrong token of an address. Returns how long its answer is to wait [s]."""
        now = time.monotonic()
        count, last = self._seen.pop(address, (0, now))
        count = 1 if now - last > FORGOTTEN_S else count + 1
        self._seen[address] = (count, now)
        while len(self._seen) > ADDRESSES_MAX:
            self._seen.popitem(last=False)
        if count & (count - 1) == 0:  # 1, 2, 4, 8, …
            log.warning("a wrong token from %s, number %d in a row", address, count)
        return 0.0 if count <= FREE else min(FIRST_DELAY_S * 2.0 ** min(count - FREE - 1, 10), DELAY_MAX_S)
