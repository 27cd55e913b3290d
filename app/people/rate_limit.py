"""Token buckets: so many tries at once, then so many in a while, for each who tries. Bounded in memory."""

import ipaddress
import time
from collections import OrderedDict
from collections.abc import Callable

MAX_KEYS = 4096


class RateLimit:
    """`burst` tries at once, then one every `every_s` seconds, for each key. Not safe across threads."""

    def __init__(self, burst: int, every_s: float, now: Callable[[], float] = time.monotonic) -> None:
        self._burst = burst
        self._every_s = every_s
        self._now = now
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def wait_s(self, key: str) -> float:
        """Count a try. Returns 0 when it may go on, else after how many seconds the next may [s]; a refused try costs none."""
        now = self._now()
        left, at = self._buckets.pop(key, (float(self._burst), now))
        left = min(self._burst, left + (now - at) / self._every_s)
        allowed = left >= 1.0
        self._buckets[key] = (left - allowed, now)
        if len(self._buckets) > MAX_KEYS:
            self._buckets.popitem(last=False)
        return 0.0 if allowed else (1.0 - left) * self._every_s


def network_of(address: str) -> str:
    """Who counts as one: an IPv4 address, or the /64 that an IPv6 host has for itself."""
    try:
        parsed = ipaddress.ip_address(address)
    except ValueError:
        return address
    return str(ipaddress.ip_network((parsed, 64), strict=False)) if parsed.version == 6 else address
