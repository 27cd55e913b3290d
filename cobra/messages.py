"""What crosses the seam between robot and consoles: values on the wire, MessagePack by msgspec.

Hosts share no clock. A stamp is the robot's own time; a command echoes the stamp of the last state its sender had seen.
"""

import math
from typing import Literal, TypeVar

import msgspec

from cobra.description import RobotDescription

Phase = Literal["disarmed", "commissioning", "homing", "ready", "driving", "holding", "stopped", "fault"]
Pair = tuple[float, float]

COMMAND_VALIDITY_S = 0.2
"""A command moves the robot for this long after its arrival."""
MAX_COMMAND_AGE_S = 0.5
"""A command whose echoed stamp is older has been on the way too long and is dropped."""


class Message(msgspec.Struct, frozen=True):
    """Base of all messages: immutable."""


class Intent(Message, frozen=True, kw_only=True):
    """What the driver wants, as rates of −1…1 in the frame of the view (x right, y down)."""

    primary: Pair = (0.0, 0.0)
    """Section mode: bending of the chosen section."""
    secondary: Pair = (0.0, 0.0)
    """Section mode: bending of the tip section."""
    feed: float = 0.0
    twist: float = 0.0
    length: float = 0.0
    """Section mode: lengthening of the chosen section, where its backbone can change its length."""
    section: int = 0
    """Index of the chosen section."""
    speed: float = 1.0
    """Scale of all rates, 0…1."""
    frame: Literal["world", "base", "tip"] = "world"
    """Whose right and down the sticks mean: those of the fixed view from behind, of the base, or of the tip camera."""
    pose: str = ""
    """Pose mode: the saved pose to go to."""


class Command(Message, frozen=True, kw_only=True):
    """One command of the driver. `held` is the dead-man: without it nothing moves."""

    lease: str
    epoch: int
    sequence: int
    echo: float
    """Stamp of the last RobotState its sender had seen [s, robot's clock]."""
    mode: str = "section"
    held: bool = False
    intent: Intent = Intent()
    input_stamp: float = 0.0
    """When the device was read [s, sender's clock]; only for measuring."""
    ended: str = ""
    """Why the last drive ended, where its driver did not let go; for people."""


class Request(Message, frozen=True, kw_only=True):
    """Something that is asked once and answered: a lease (see `cobra.control.lease_requests`), or an act of the driver's
    (arm, disarm, home, clear the stop, quit, and what parts of the loop add; see `cobra.control.requests`)."""

    what: str
    lease: str = ""
    who: str = ""
    reason: str = ""
    name: str = ""
    """What the act is about, where it needs a name."""
    value: float = 0.0
    """The act's number, where it needs one, in the unit that the act says."""


class Reply(Message, frozen=True, kw_only=True):
    """The answer to a request. When it is refused, `reasons` say why in words."""

    ok: bool
    reasons: tuple[str, ...] = ()
    lease: str = ""
    epoch: int = 0


class Stop(Message, frozen=True, kw_only=True):
    """Anybody may stop. `who` is shown to everybody."""

    who: str = ""
    reason: str = ""
    press: str = ""
    """By this mark a STOP that is said again counts once; without one every message counts."""


class HandFedLength(Message, frozen=True, kw_only=True):
    """A measuring device's reading of a robot that is fed by hand."""

    length_m: float
    """Exposed length beyond the entry port."""


class Push(Message, frozen=True, kw_only=True):
    """A force on the twin, as a hand would push it. Only a simulated plant listens; it moves no drive."""

    vertebra: int
    """Counted as in the twin's truth, base first."""
    force_N: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """In the frame of the port; nothing ends the push."""


class Event(Message, frozen=True, kw_only=True):
    """Something worth telling people, once."""

    stamp: float
    level: Literal["info", "warning", "alarm", "marker"]
    """A marker is what an operator wanted to be found again."""
    text: str


class Drives(Message, frozen=True, kw_only=True):
    """Feedback of all drives, in the description's order. Lists of equal length."""

    travel: tuple[float, ...]
    """m of tendon paid out, m of feed, rad of twist, from the reference found in homing."""
    setpoint: tuple[float, ...]
    velocity: tuple[float, ...]
    load: tuple[float, ...]
    """Tendon tension or feed force [N], twist torque [N·m], from motor current."""
    temperature: tuple[float, ...]
    voltage: tuple[float, ...]
    age: tuple[float, ...]
    """Seconds since the last valid reply."""
    valid: tuple[bool, ...]
    fault: tuple[str, ...]
    """In words; empty when there is none."""
    current: tuple[float, ...] = ()
    """[A] of the motor; positive drives its shaft in its positive direction."""
    missed: tuple[int, ...] = ()
    """Replies missed in a row."""
    warning: tuple[str, ...] = ()
    """What is near a limit, in words; empty where nothing is."""


class Channel(Message, frozen=True, kw_only=True):
    """One CAN channel."""

    name: str
    load: float = 0.0
    """Part of the bit rate that frames took over the last second, 0…1."""
    frame_rate_Hz: float = 0.0
    trouble: str = ""
    """In words with what to do; empty when all is well."""


class Cell(Message, frozen=True, kw_only=True):
    """The load cell of one tendon."""

    tendon: str
    tension: float
    """[N]; NaN while it cannot be believed."""
    from_current: float = math.nan
    """[N] what the motor's current says, without the gear's friction as described."""
    reading: float
    """[N] by the described scale alone, neither tared nor calibrated; NaN until first heard."""
    age: float
    """[s] since its last frame."""
    trouble: str = ""
    """Why it cannot be believed, in words with what to do."""


CompensationState = Literal["none", "off", "on"]


class Tendons(Message, frozen=True, kw_only=True):
    """What is known of the tendons beyond their drives, in the order of the description; empty before homing."""

    compensation: CompensationState = "none"
    """Whether stretch, friction and play are taken out of what the drives are told."""
    parameters: str = ""
    """Where its numbers come from, in words."""
    tension: tuple[float, ...] = ()
    """At the spool [N], without the gear's friction."""
    profile: tuple[tuple[float, ...], ...] = ()
    """Of each tendon [N]: at motor, port and the end of each section; NaN beyond its own end."""
    deviation: tuple[float, ...] = ()
    """Standard deviation of each entry of `RobotState.measured` that tendons tell; 0 for the others."""
    residual: tuple[float, ...] = ()
    """Length that no shape explains [m]."""
    warnings: tuple[str, ...] = ()
    """In words, with what to do."""


class Timing(Message, frozen=True, kw_only=True):
    """The loop's own timing over the last seconds [s]."""

    rate_Hz: float = 0.0
    period_p50: float = 0.0
    period_p99: float = 0.0
    period_max: float = 0.0
    compute_p99: float = 0.0
    late: int = 0
    realtime: bool = False


class Lease(Message, frozen=True, kw_only=True):
    """Who drives, and since when."""

    holder: str = ""
    since: float = 0.0
    fresh: bool = False
    asking: tuple[str, ...] = ()
    """Who asks the holder for the controls."""
    kept_for: str = ""
    """To whom the holder has just given them; nobody else can acquire them for a moment."""


Rigidity = Literal["none", "continuum", "locking", "rigid", "unlocking"]


class LockReport(Message, frozen=True, kw_only=True):
    """Whether a robot that can lock bends or is rigid; "none" for one that cannot lock."""

    status: Rigidity = "none"
    words: str = ""
    """What that means now, or why what was asked is refused."""


class Commissioned(Message, frozen=True, kw_only=True):
    """One thing that a step of commissioning found out."""

    drive: str
    """Or the tendon whose zero or load cell it is about."""
    check: str
    ok: bool
    words: str


class CommissioningReport(Message, frozen=True, kw_only=True):
    """The step of commissioning that runs, or that ran last."""

    step: str = ""
    """What was asked for: identify, test, home_repeatedly, tare or calibrate_cell; empty before the first."""
    doing: str = ""
    """In words, while it runs."""
    outcome: str = ""
    """running, done, or ended: before it was done."""
    words: str = ""
    """Why it was ended."""
    found: tuple[Commissioned, ...] = ()
    calibration: str = ""
    """The one in use: version, date and what was done, in words; empty before any."""


PATH_POINTS = 60
"""At most so many points of the path are told: it is drawn, not computed with."""


class PathReport(Message, frozen=True, kw_only=True):
    """Tip following: the path that is remembered, and how well the body lies on it."""

    points: tuple[float, ...]
    """x, y, z after each other in the port frame, from the port on, thinned out for drawing [m]."""
    length_m: float
    deviation_m: float
    """Largest distance of the exposed body from the path now."""
    deviation_max_m: float
    """The largest since this mode was chosen."""


class HandFeedReport(Message, frozen=True, kw_only=True):
    """The exposed length of a robot that is fed by hand."""

    told_m: float
    """What was told last."""
    used_m: float
    """What the robot is driven with: led towards what was told while the dead-man is held."""
    source: Literal["number", "measured", "silent"]
    """Told by a person, by a measuring device, or by one that has fallen silent since."""


class ModeReport(Message, frozen=True, kw_only=True):
    """What the mode that moves the robot has to say."""

    words: tuple[str, ...] = ()
    """What keeps it from what was asked, or how far it is."""
    share: float = 1.0
    """Tip mode: how much of the wanted motion is given; under 1 something binds."""
    fallbacks: int = 0
    """Tip mode: how often the solver failed and damped least squares stepped in."""
    target: tuple[float, ...] = ()
    """The q that it goes to."""
    path: PathReport | None = None


class MotionReport(Message, frozen=True, kw_only=True):
    """The modes of motion, and what they have to say."""

    modes: tuple[str, ...] = ()
    """Those that the robot offers."""
    poses: tuple[str, ...] = ()
    """Names of the saved poses."""
    pose: str = ""
    """The saved pose chosen."""
    doing: ModeReport = ModeReport()
    hand_feed: HandFeedReport | None = None


class RobotState(Message, frozen=True, kw_only=True):
    """One immutable snapshot of a tick."""

    robot: str
    stamp: float
    tick: int
    phase: Phase
    cause: str = ""
    """Why it holds, stopped or failed, in words with what to do."""
    reasons: tuple[str, ...] = ()
    """What still prevents arming."""
    homed: bool = False
    epoch: int = 0
    stops: tuple[str, ...] = ()
    """Marks of the newest STOPs that were obeyed, so that whoever pressed knows."""
    lease: Lease = Lease()
    accepted: int = 0
    """Sequence number of the last command that was obeyed."""
    mode: str = "section"
    commanded: tuple[float, ...] = ()
    """q: twist [rad], feed [m], then b_x, b_y [rad] of each section (and its length [m] where it can change)."""
    measured: tuple[float, ...] = ()
    """The same from motor feedback alone."""
    drives: Drives
    tendons: Tendons = Tendons()
    cells: tuple[Cell, ...] = ()
    """The load cells, beside what the drives' currents say."""
    drops: dict[str, int] = {}
    """Commands that were not obeyed, by reason."""
    channels: tuple[Channel, ...] = ()
    notes: tuple[str, ...] = ()
    """What people should know about the motors, in words."""
    bus: dict[str, int] = {}
    """Frames that were not usable, by reason."""
    timing: Timing = Timing()
    motion: MotionReport = MotionReport()
    lock: LockReport = LockReport()
    commissioning: CommissioningReport = CommissioningReport()


class Judged(Message, frozen=True, kw_only=True):
    """A command as it arrived and what the robot made of it. Its lease is a fingerprint only."""

    stamp: float
    """Arrival [s, robot's clock]."""
    command: Command
    dropped: str = ""
    """Why it was not obeyed; empty when it was."""


class Answered(Message, frozen=True, kw_only=True):
    """A request and its answer. Leases are fingerprints only."""

    stamp: float
    request: Request
    reply: Reply


class Heard(Message, frozen=True, kw_only=True):
    """All that the robot was told in one tick, for whoever records."""

    commands: tuple[Judged, ...] = ()
    answers: tuple[Answered, ...] = ()
    omitted: int = 0
    """Of a flood: what arrived beside these in the same tick."""


class DriveCalibration(Message, frozen=True, kw_only=True):
    """What turns a drive's shaft and current into travel and load: m or rad of travel, N or N·m of load."""

    travel_per_rad: float
    load_per_A: float
    zero_rad: float | None = None
    """Angle of the shaft at which the travel is zero, as homing found it; None before that."""


class CellScale(Message, frozen=True, kw_only=True):
    """A load cell's tension is `gain` (reading - offset_N) [N]."""

    gain: float
    offset_N: float


class Calibration(Message, frozen=True, kw_only=True):
    """What the robot goes by now, beyond its description. Told whenever it changes."""

    stamp: float
    """Since when [s, robot's clock]."""
    homed: bool
    drives: dict[str, DriveCalibration]
    """By name."""
    source: str = ""
    """Where the numbers of the tendons' losses come from, in words; empty where there are none."""
    losses: dict[str, float | tuple[float, ...]] = {}
    """Of the tendons, as in `cobra.mechanics.losses.Losses`."""
    deviation: dict[str, float | tuple[float, ...]] = {}
    """Standard deviation of each of them."""
    version: int = 0
    """Of the calibration that commissioning kept, where one is in use: `cobra-teleop motors calibrations` lists them."""
    serial: str = ""
    date: str = ""
    by: str = ""
    """When and by what it was made."""
    cells: dict[str, CellScale] = {}
    """Load cells by tendon."""


class Walls(Message, frozen=True, kw_only=True):
    """What surrounds a simulated robot, for the eye."""

    title: str
    vertices: bytes
    """Float32, three a point [m], in the frame of the entry port."""
    faces: bytes
    """Uint32, three corners a triangle."""
    solid_from: int
    """The triangles from this one on are drawn solid, those before can be seen through."""


Point = tuple[float, float, float]


class Touch(Message, frozen=True, kw_only=True):
    """Of the twin's truth what walls have to do with: for tests and for the 3D view, which says whose knowledge it is."""

    vertebrae: tuple[Point, ...] = ()
    """Centres of the vertebrae, base first [m]."""
    passive: tuple[Point, ...] = ()
    """Along the passive body behind them, base first [m]."""
    contact_points: tuple[Point, ...] = ()
    """Where walls press on the robot [m]."""
    contact_forces: tuple[Point, ...] = ()
    """On the robot [N]."""
    clearance_m: float = math.inf
    """From the body's skin to the nearest wall."""
    clearance_points: tuple[Point, ...] = ()
    """The nearest two points of body's axis and wall [m]."""


def tensions_of(description: RobotDescription, state: RobotState) -> tuple[float, ...]:
    """Tension of each tendon [N]: estimated where it is known, else the load of its drive with the gear's friction in it.

    A tendon only pulls: a drive that pushes against its own friction shows no tension.
    """
    known = state.tendons.tension
    if len(known) == len(description.tendon_names):
        return known
    return tuple(max(state.drives.load[i], 0.0) for i in description.tendon_drives)


class Meta(Message, frozen=True, kw_only=True):
    """Answered once to whoever connects."""

    description: str
    """The robot description as TOML text."""
    versions: dict[str, str]
    pid: int
    simulated: bool = False
    """Whether every bus, as it was led when this robot was started, ends at simulated drives."""
    walls: Walls | None = None
    notes: tuple[str, ...] = ()
    """What people should know of how this robot was started."""


M = TypeVar("M", bound=Message)


def encode(message: Message) -> bytes:
    return msgspec.msgpack.encode(message)


def decode(data: bytes, kind: type[M]) -> M:
    """Decode one message.

    Raises:
        msgspec.DecodeError, msgspec.ValidationError: the bytes are not such a message.
    """
    return msgspec.msgpack.decode(data, type=kind)
