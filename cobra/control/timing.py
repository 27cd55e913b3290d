"""The loop's own timing over the last seconds."""

import numpy as np

from cobra.messages import Timing

LATE_FRACTION = 0.5
"""A period longer than 1.5 times the nominal counts as late."""


class LoopTiming:
    """Ring of the last periods and computation times; a summary once a second, since percentiles cost time."""

    def __init__(self, period_s: float, window: int = 500) -> None:
        self._nominal = period_s
        self._periods = np.full(window, np.nan)
        self._work = np.full(window, np.nan)
        self._count = 0
        self._last: float | None = None
        self._late = 0
        self._summary = Timing()
        self._restart = False
        self.realtime = False

    def restart(self) -> None:
        """Forget what was recorded, with the next tick. Safe from any thread."""
        self._restart = True

    def tick(self, start_s: float, work_s: float) -> Timing:
        """Record one tick by its start and the time it computed; returns the newest summary."""
        if self._restart:
            self._restart, self._late, self._count, self._last = False, 0, 0, None
            self._periods[:] = self._work[:] = np.nan
            self._summary = Timing(realtime=self.realtime)
        i = self._count % len(self._periods)
        if self._last is not None:
            period = start_s - self._last
            self._periods[i] = period
            self._late += period > self._nominal * (1.0 + LATE_FRACTION)
        self._work[i] = work_s
        self._last = start_s
        self._count += 1
        if self._count % max(int(1.0 / self._nominal), 1) == 0:
            self._summary = self._summarise()
        return self._summary

    def _summarise(self) -> Timing:
        periods = self._periods[~np.isnan(self._periods)]
        p50, p99 = np.percentile(periods, [50, 99])
        return Timing(
            rate_Hz=float(1.0 / np.mean(periods)),
            period_p50=float(p50),
            period_p99=float(p99),
            period_max=float(np.max(periods)),
            compute_p99=float(np.nanpercentile(self._work, 99)),
            late=self._late,
            realtime=self.realtime,
        )
