"""What the operator's page is told: facts once in `Welcome`, then a `Snapshot` 20 times a second. Plain JSON.

Numbers that are not known (not measured yet, not finite) are None; the page shows a dash for them.
"""

from typing import NotRequired, TypedDict

from app.console.commissioning_view import CommissioningState
from app.people.roles import Role
from cobra.messages import Phase

Number = float | None


class PadControls(TypedDict):
    """`Controls` as JSON: sticks −1…1 (x right, y down), triggers 0…1, the pressed buttons by name."""

    left: tuple[float, float]
    right: tuple[float, float]
    lt: float
    rt: float
    buttons: list[str]


class Pad(TypedDict):
    """The pad plugged into the console's computer; `name` is empty when there is none."""

    name: str
    connected: bool
    controls: PadControls


class LinkState(TypedDict):
    """`ok`: states arrive. `robot`: the robot process runs; when it does not, the page offers to restart it."""

    ok: bool
    robot: bool
    age_ms: Number
    trip_ms: Number
    """Round trip between console and robot process; what the page measures is its own way to the console."""


class LeaseState(TypedDict):
    holder: str
    since_s: Number
    fresh: bool
    asking: list[str]
    """Who asks for the controls."""


class SeatState(TypedDict):
    """Who holds the lease through this console: the page `page`, or with `shared` whoever comes."""

    shared: bool
    page: str
    console_pad: bool
    """Whether the pad plugged into the console's computer drives."""


class Person(TypedDict):
    name: str
    role: Role


class Bend(TypedDict):
    """A section's measured bend: `dir_deg` from +x (right) towards +y (down) in the view from behind."""

    name: str
    deg: Number
    dir_deg: Number
    limit_deg: float


class DriveState(TypedDict):
    """`moves` is tendon, twist or feed; `load` in N, for the twist in N·m; `fault` in words, empty for none."""

    name: str
    moves: str
    temperature: Number
    voltage: Number
    load: Number
    age_ms: Number
    current: Number
    missed: int
    warning: str
    fault: str


class ChannelState(TypedDict):
    """A CAN channel; `load` is the part of its bit rate in use, `trouble` in words, empty for none."""

    name: str
    load: float
    trouble: str


class TensionLimits(TypedDict):
    min: float
    max: float


class LockState(TypedDict):
    """`status`: none, continuum, locking, rigid or unlocking; `words`: what that means, or what is refused and why."""

    status: str
    words: str


class EventLine(TypedDict):
    """`ago` in seconds; `level` is info, warning, alarm or marker; `stamp` on the robot's clock tells them apart."""

    level: str
    text: str
    ago: float
    stamp: NotRequired[float]


class RecordingState(TypedDict):
    """How the session is recorded; `name` is empty when it is not to be, `problem` in words, empty for none."""

    name: str
    problem: str
    megabytes: float
    lost: int
    """Messages that are not in the recording: the disk was too slow or full, or the link dropped them."""


class LineState(TypedDict):
    """One control: on a pad, on the keyboard, and what it does."""

    pad: str
    keys: str
    does: str


class GuideState(TypedDict):
    """One mode, for people; `left` to `twist` say in a word what the page's sticks and buttons do, or are empty."""

    name: str
    title: str
    help: str
    left: str
    right: str
    feed: str
    twist: str
    lines: list[LineState]


class PathState(TypedDict):
    """Tip following: how well the body lies on the path."""

    deviation_mm: Number
    deviation_max_mm: Number
    length_mm: Number


class HandFeedState(TypedDict):
    """`source` is number, measured, or silent: a measuring device that does not tell any more."""

    told_mm: Number
    used_mm: Number
    source: str


class MotionState(TypedDict):
    """What the mode that moves the robot has to say."""

    words: list[str]
    share: Number
    """Tip mode: how much of the wanted motion is given."""
    fallbacks: int
    path: PathState | None
    poses: list[str]
    pose: str
    """The one chosen on this console."""
    hand_feed: HandFeedState | None


class Snapshot(TypedDict):
    """The state for the page."""

    phase: Phase
    cause: str
    hints: dict[str, str]
    """For the pad and for every page, by name: what it does, or what is missing for it to drive."""
    reasons: list[str]
    homed: bool
    link: LinkState
    lease: LeaseState
    seat: SeatState
    people: list[Person]
    """Who has a page open."""
    driver: str
    """Whose input drives: "pad", the name of a page (`Welcome.page`), or empty for nobody's."""
    pad: Pad
    mode: str
    """The one chosen on this console."""
    frame: str
    """The view that the sticks go by, of `Welcome.frames`."""
    motion: MotionState
    section: int
    speed: int
    bends: list[Bend]
    twist_deg: Number
    feed_mm: Number
    length_mm: Number
    """Of the section that can change its length: the chosen one, else the first; None where none can."""
    lock: LockState
    tip_mm: list[Number]
    tensions: list[Number]
    """In the order of `Welcome.tendons` [N]; without the gears' friction, once it is homed."""
    profiles: list[list[Number]]
    """Along each tendon [N]: at motor, port and the end of each section that it passes; empty where that is not known."""
    tendons: "TendonsState"
    tension_limits: TensionLimits
    drives: list[DriveState]
    channels: list[ChannelState]
    notes: list[str]
    drops: dict[str, int]
    bus: dict[str, int]
    timing: dict[str, float]
    """The fields of `cobra.messages.Timing`, in seconds and hertz."""
    events: list[EventLine]
    """Newest first."""
    console_rate: float
    """States that reached the console in the last second [Hz]."""
    recording: RecordingState
    commissioning: CommissioningState


class TendonsState(TypedDict):
    """`compensation` is none, off or on; `words` say so, with the uncertainty of the bends; `warnings` what to do."""

    compensation: str
    words: str
    warnings: list[str]


class Limits(TypedDict):
    """Ranges of the bars; None where the robot has no such drive."""

    twist_deg: tuple[float, float] | None
    feed_mm: tuple[float, float] | None
    length_mm: tuple[float, float] | None


class Welcome(TypedDict):
    """Static facts, sent once to a page that connects."""

    robot: str
    title: str
    summary: str
    sections: list[str]
    bending: list[int]
    """Indices of the sections with tendons of their own; the others are passive."""
    limits: Limits
    speed_levels: list[float]
    tendons: list[str]
    max_tension_N: float
    modes: list[GuideState]
    frames: list[str]
    active_length_mm: Number
    """What lies beyond it outside the port follows by itself; None for a robot that is passive all along."""
    hand_fed: bool
    """Somebody feeds it by hand and tells the length."""
    versions: dict[str, str]
    danger: str
    """What everybody has to know about how the page is served; empty when it is as it should be."""
    elsewhere: str
    """Through what a robot on another machine is reached, which is not started and ended from here; empty for one that is."""
    page: NotRequired[str]
    """The page's own name; this and the following are added by the socket."""
    user: NotRequired[str]
    role: NotRequired[Role]
    view: NotRequired[str]
    """Where the 3D view is found under another name of the same machine."""


class Answer(TypedDict):
    """What became of a request; `reasons` say in words why it was refused."""

    ok: bool
    reasons: list[str]
