"""Plays one recording, or two over each other: a clock that can be stopped, hurried and set. No bus, no link, no motor."""

import threading
from collections.abc import Sequence
from typing import Final

from app.recording.reader import Recording
from cobra.clock import Clock
from cobra.messages import RobotState

SPEEDS: Final = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)


class Player:
    """Where playing stands. Safe from any thread."""

    def __init__(self, recordings: Sequence[Recording], clock: Clock) -> None:
        """The first is played; the second, where there is one, is shown beside it at the same time plus an offset."""
        self.recordings = tuple(recordings)
        self._clock = clock
        self._lock = threading.Lock()
        self._playing = False
        self._speed = 1.0
        self._time_s = 0.0
        self._since_s = 0.0
        self._offset_s = 0.0
        self.jumps = 0
        """How often time was set: what is drawn as a history begins anew then."""

    @property
    def duration_s(self) -> float:
        return self.recordings[0].duration_s

    @property
    def playing(self) -> bool:
        with self._lock:
            self._advance()
            return self._playing

    @property
    def speed(self) -> float:
        return self._speed

    @property
    def offset_s(self) -> float:
        """The other recording's time less the first one's."""
        return self._offset_s

    @property
    def time_s(self) -> float:
        """From the start of the first recording."""
        with self._lock:
            self._advance()
            return self._time_s

    def play(self) -> None:
        """Go on; from the end, start over."""
        with self._lock:
            self._advance()
            if self._time_s >= self.duration_s:
                self._time_s = 0.0
                self.jumps += 1
            self._playing, self._since_s = True, self._clock.now()

    def pause(self) -> None:
        with self._lock:
            self._advance()
            self._playing = False

    def seek(self, time_s: float) -> None:
        """Set the time, within the recording."""
        with self._lock:
            self._time_s = min(max(time_s, 0.0), self.duration_s)
            self._since_s = self._clock.now()
            self.jumps += 1

    def set_speed(self, speed: float) -> None:
        """How many seconds a second, within `SPEEDS`."""
        with self._lock:
            self._advance()
            self._speed = min(max(speed, SPEEDS[0]), SPEEDS[-1])

    def set_offset(self, offset_s: float) -> None:
        """Move the other recording against the first."""
        with self._lock:
            self._offset_s = offset_s
            self.jumps += 1

    def state(self) -> RobotState | None:
        """Of the first recording, now."""
        time_s = self.time_s
        with self._lock:
            return self.recordings[0].state_at(time_s)

    def other_state(self) -> RobotState | None:
        """Of the second recording, now; None when there is none, or when it has not begun or is over."""
        if len(self.recordings) < 2:
            return None
        time_s = self.time_s + self._offset_s
        with self._lock:
            other = self.recordings[1]
            return other.state_at(time_s) if 0.0 <= time_s <= other.duration_s else None

    def _advance(self) -> None:
        if not self._playing:
            return
        now = self._clock.now()
        self._time_s += self._speed * (now - self._since_s)
        self._since_s = now
        if self._time_s >= self.duration_s:
            self._time_s, self._playing = self.duration_s, False
