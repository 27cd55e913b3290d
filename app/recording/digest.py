"""A session in brief: what the catalogue lists, the time line draws and the report tells. Made while recording."""

import math
from collections import Counter
from typing import Final

import msgspec
import numpy as np

from app.recording.channels import Level
from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import Configuration
from cobra.messages import Event, Judged, RobotState

OVERVIEW_POINTS: Final = 2000
"""When there would be more, every second one goes and the step doubles."""
MOST_EVENTS: Final = 5000
PATH_STEP_S: Final = 0.05
"""The tip's path is taken at this step …"""
PATH_NOISE_m: Final = 0.0005
"""… and only where it moved by more than this, so that noise at rest does not add up to a way."""


class Span(msgspec.Struct, frozen=True):
    """Something that was so for a while. Seconds from the start of the recording."""

    what: str
    start_s: float
    end_s: float


class Happening(msgspec.Struct, frozen=True):
    """An event on the time line."""

    time_s: float
    level: Level
    text: str


class Overview(msgspec.Struct, frozen=True, kw_only=True):
    """The whole session at a coarse step; lists of equal length, None where a value is not known."""

    step_s: float = 1.0
    tension_N: tuple[float | None, ...] = ()
    """Highest tendon tension within each step."""
    bend_deg: tuple[float | None, ...] = ()
    """Largest measured bend of any section within each step."""


class Digest(msgspec.Struct, frozen=True, kw_only=True):
    """What a session held."""

    robot: str = ""
    title: str = ""
    started_ns: int = 0
    """Wall clock of the first message."""
    duration_s: float = 0.0
    states: int = 0
    missed: int = 0
    """Ticks of the robot that the recording does not have."""
    dropped: int = 0
    """Messages that the disk was too slow or too full for."""
    drivers: tuple[Span, ...] = ()
    phases: tuple[Span, ...] = ()
    driving_s: float = 0.0
    path_m: float = 0.0
    """Way of the measured tip."""
    max_bend_deg: dict[str, float] = {}
    """By section."""
    max_tension_N: dict[str, float] = {}
    """By tendon."""
    max_temperature_C: float | None = None
    faults: tuple[str, ...] = ()
    """Causes, each once."""
    counts: dict[Level, int] = {}
    """Events by level."""
    events: tuple[Happening, ...] = ()
    obeyed: int = 0
    refused: dict[str, int] = {}
    """Commands that were dropped, by reason."""
    period_p99_s: float | None = None
    """Worst over the session."""
    period_max_s: float | None = None
    late_ticks: int = 0
    loop_rate_Hz: float | None = None
    overview: Overview = Overview()
    recovered: str = ""
    """What `recover` says of it; empty for a file that was closed in order."""


class Digester:
    """Takes a session's messages in order and keeps their digest."""

    def __init__(self, robot: str, description: RobotDescription | None) -> None:
        """Without a description (of a newer version, say) shape and tension stay unknown."""
        self._robot = robot
        self._description = description
        self._layout = Configuration(description) if description else None
        self._backbone = Backbone(description) if description else None
        self._first_ns = self._last_ns = 0
        self._states = self._missed = self._obeyed = self._late = 0
        self._tick = -1
        self._drivers: list[tuple[str, float, float]] = []
        self._phases: list[tuple[str, float, float]] = []
        self._tip: np.ndarray | None = None
        self._next_tip_s = 0.0
        self._path_m = 0.0
        n = len(description.sections) if description else 0
        self._bend = np.zeros(n)
        self._tension = np.full(len(description.tendon_names) if description else 0, -math.inf)
        self._temperature = -math.inf
        self._faults: dict[str, None] = {}
        self._counts: Counter[Level] = Counter()
        self._events: list[Happening] = []
        self._refused: Counter[str] = Counter()
        self._p99 = self._longest = 0.0
        self._rate = math.nan
        self._curves = _Curves()
        self.dropped = 0

    def seconds(self, time_ns: int) -> float:
        """From the start of the recording."""
        if not self._first_ns:
            self._first_ns = time_ns
        self._last_ns = max(self._last_ns, time_ns)
        return (time_ns - self._first_ns) * 1e-9

    def state(self, state: RobotState, time_ns: int) -> None:
        t = self.seconds(time_ns)
        self._states += 1
        if 0 <= self._tick < state.tick:
            self._missed += state.tick - self._tick - 1
        self._tick = state.tick
        _extend(self._drivers, state.lease.holder, t)
        _extend(self._phases, state.phase, t)
        if state.phase == "fault":
            self._faults.setdefault(state.cause)
        timing = state.timing
        self._p99, self._longest = max(self._p99, timing.period_p99), max(self._longest, timing.period_max)
        self._late, self._rate = max(self._late, timing.late), timing.rate_Hz or self._rate
        if t >= self._next_tip_s or t < self._next_tip_s - 10 * PATH_STEP_S:
            self._next_tip_s = t + PATH_STEP_S
            self._shape(state, t)

    def event(self, event: Event, time_ns: int) -> None:
        t = self.seconds(time_ns)
        self._counts[event.level] += 1
        if len(self._events) < MOST_EVENTS:
            self._events.append(Happening(round(max(t, 0.0), 4), event.level, event.text))

    def judged(self, judged: Judged) -> None:
        if judged.dropped:
            self._refused[judged.dropped] += 1
        else:
            self._obeyed += 1

    def result(self, recovered: str = "") -> Digest:
        names = self._description
        return Digest(
            robot=self._robot,
            title=names.title if names else self._robot,
            started_ns=self._first_ns,
            duration_s=(self._last_ns - self._first_ns) * 1e-9,
            states=self._states,
            missed=self._missed,
            dropped=self.dropped,
            drivers=tuple(Span(*span) for span in self._drivers if span[0]),
            phases=tuple(Span(*span) for span in self._phases),
            driving_s=sum(end - start for what, start, end in self._phases if what == "driving"),
            path_m=self._path_m,
            max_bend_deg={s.name: float(b) for s, b in zip(names.sections, self._bend, strict=True)} if names else {},
            max_tension_N={
                name: float(value)
                for name, value in zip(names.tendon_names if names else (), self._tension, strict=True)
                if math.isfinite(value)
            },
            max_temperature_C=_known(self._temperature),
            faults=tuple(self._faults),
            counts=dict(self._counts),
            # Those from before the recorder listened are told to it later.
            events=tuple(sorted(self._events, key=lambda event: event.time_s)),
            obeyed=self._obeyed,
            refused=dict(self._refused),
            period_p99_s=self._p99 or None,
            period_max_s=self._longest or None,
            late_ticks=self._late,
            loop_rate_Hz=_known(self._rate),
            overview=self._curves.result(),
            recovered=recovered,
        )

    def _shape(self, state: RobotState, t: float) -> None:
        """Bends, tension and the tip's way; nothing of it is known before homing."""
        description, layout, backbone = self._description, self._layout, self._backbone
        if description is None or layout is None or backbone is None or len(state.measured) != layout.size:
            return
        q = np.array(state.measured)
        if not state.homed or not np.isfinite(q).all():
            self._tip = None
            return
        bends = np.degrees([math.hypot(*q[where]) for where in layout.bends])
        self._bend = np.maximum(self._bend, bends)
        load = np.array(state.drives.load)
        tension = load[list(description.tendon_drives)] if len(load) == len(description.drives) else np.zeros(0)
        if len(tension):
            self._tension = np.fmax(self._tension, tension)
        heat = [value for value in state.drives.temperature if math.isfinite(value)]
        self._temperature = max([self._temperature, *heat])
        self._curves.add(t, float(np.nanmax(tension, initial=-math.inf)), float(np.max(bends, initial=0.0)))
        tip = backbone.tip(q)[:3, 3]
        way = 0.0 if self._tip is None else float(np.linalg.norm(tip - self._tip))
        if self._tip is None or way > PATH_NOISE_m:
            self._tip = tip
            self._path_m += way


class _Curves:
    """The overview, at a step that doubles when there are too many points."""

    def __init__(self) -> None:
        self._step_s = 1.0
        self._points: list[tuple[float, float]] = []

    def add(self, t: float, tension: float, bend: float) -> None:
        place = int(t / self._step_s)
        while place >= OVERVIEW_POINTS:
            pairs = [self._points[i : i + 2] for i in range(0, len(self._points), 2)]
            self._points = [(max(a for a, _ in pair), max(b for _, b in pair)) for pair in pairs]
            self._step_s *= 2.0
            place = int(t / self._step_s)
        unknown = (-math.inf, -math.inf)
        self._points += [unknown] * (place + 1 - len(self._points))
        before = self._points[place]
        self._points[place] = (max(before[0], tension), max(before[1], bend))

    def result(self) -> Overview:
        return Overview(
            step_s=self._step_s,
            tension_N=tuple(
                _known(round(tension, 2)) if math.isfinite(tension) else None for tension, _ in self._points
            ),
            bend_deg=tuple(_known(round(bend, 2)) if math.isfinite(bend) else None for _, bend in self._points),
        )


def _extend(spans: list[tuple[str, float, float]], what: str, t: float) -> None:
    """Go on with the last span, or begin another one where the last ends."""
    if spans and spans[-1][0] == what:
        spans[-1] = (what, spans[-1][1], t)
        return
    if spans:
        spans[-1] = (spans[-1][0], spans[-1][1], t)
    spans.append((what, t, t))


def _known(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
