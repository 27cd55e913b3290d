"""What a subcommand is, and the arguments that several of them share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from cobra.simulation.losses import Losses
from cobra.simulation.options import ENVIRONMENTS, NOWHERE_ELSE, Simulation, TwinKind

if TYPE_CHECKING:
    from app.console.console import ConsoleOptions
    from app.link.access import LinkAccess

RobotName = Annotated[str, tyro.conf.arg(help="Name of a robot that comes with the program, or path of a description.")]
CanLog = Annotated[
    Path | None, tyro.conf.arg(metavar="FILE", help="Write every CAN frame to FILE (.log for candump, or .blf).")
]
SkipBadRows = Annotated[
    bool, tyro.conf.arg(help="Leave out rows of the CSV that cannot be used, and say which and why.")
]
FigureFolder = Annotated[Path, tyro.conf.arg(metavar="FOLDER", help="For numbers and pictures.")]

RecordFolder = Annotated[
    Path | None,
    tyro.conf.arg(metavar="DIR", help="Folder of the recordings; by default ~/.local/share/cobra-teleop/recordings."),
]
RecordBudget = Annotated[
    float, tyro.conf.arg(metavar="GB", help="Room for recordings; beyond it the oldest unmarked ones are deleted.")
]


@dataclass(frozen=True, kw_only=True)
class LinkArguments:
    """What a router asks of those who connect."""

    account: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="Account for the router, from `cobra-teleop router account`.")
    ] = None
    ca: Annotated[
        Path | None, tyro.conf.arg(metavar="FILE", help="Certificate of the authority of tls/ endpoints (PEM).")
    ] = None

    def access(self) -> "LinkAccess":
        from app.link.access import LinkAccess  # brings Zenoh

        return LinkAccess(account=self.account, ca=self.ca)


DIRECTLY = LinkArguments()
Linked = Annotated[LinkArguments, tyro.conf.arg(name="")]


@dataclass(frozen=True, kw_only=True)
class PageArguments:
    """How a console's page is served."""

    host: Annotated[
        str, tyro.conf.arg(help="Address to serve the page on; others than loopback need users and TLS.")
    ] = "127.0.0.1"
    tls_cert: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="Certificate with its chain, PEM.")] = None
    tls_key: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="The certificate's key, PEM.")] = None
    name: Annotated[
        tuple[str, ...], tyro.conf.arg(metavar="NAME", help="Further host names by which browsers may come.")
    ] = ()
    insecure: Annotated[
        bool, tyro.conf.arg(help="Listen beyond loopback without users or TLS all the same; the page says so.")
    ] = False


HERE_ONLY = PageArguments()
Served = Annotated[PageArguments, tyro.conf.arg(name="")]
PagePort = Annotated[int, tyro.conf.arg(help="Port of the page; when it is taken the next free one is used.")]
FrameRate = Annotated[float, tyro.conf.arg(help="Frames per second of the 3D scene.")]
NoRecord = Annotated[bool, tyro.conf.FlagCreatePairsOff, tyro.conf.arg(help="Record nothing.")]


@dataclass(frozen=True, kw_only=True)
class ConsoleArguments:
    """The operator's console: its page and 3D view, the pad, and what it records."""

    port: PagePort = 8080
    page: Served = HERE_ONLY
    open_page: Annotated[
        bool, tyro.conf.arg(name="open", help="Open the page in the browser, where there is a screen.")
    ] = True
    pad: Annotated[bool, tyro.conf.arg(help="Read a gamepad plugged into this computer.")] = True
    frame_rate: FrameRate = 30.0
    record: RecordFolder = None
    no_record: NoRecord = False
    record_budget: RecordBudget = 20.0

    def options(self, robot: str, **where: Any) -> "ConsoleOptions":
        """Of the console that drives `robot`; `where`: what else `ConsoleOptions` takes."""
        from app.console.console import ConsoleOptions

        return ConsoleOptions(
            robot=robot,
            host=self.page.host,
            port=self.port,
            tls_cert=self.page.tls_cert,
            tls_key=self.page.tls_key,
            names=self.page.name,
            insecure=self.page.insecure,
            open_page=self.open_page,
            pad=self.pad,
            frame_rate_Hz=self.frame_rate,
            record=not self.no_record,
            record_folder=self.record,
            record_budget_GB=self.record_budget,
            **where,
        )


AS_USUAL = ConsoleArguments()
Operated = Annotated[ConsoleArguments, tyro.conf.arg(name="")]


@dataclass(frozen=True, kw_only=True)
class SimulationArguments:
    """How simulated drives and what they move are simulated; without effect on hardware."""

    twin: Annotated[
        TwinKind,
        tyro.conf.arg(
            help="Physics behind simulated drives: with stretch, friction and gravity, ideal (stiff, no gravity), the paper's "
            "equations of motion (dynamics; for src-bot), or none."
        ),
    ] = "default"
    losses: Annotated[
        Losses,
        tyro.conf.arg(
            help="Friction, lost motion and stiffness of the default twin: drawn within 30 percent of the description's, "
            "just as described, or no friction and no lost motion."
        ),
    ] = "nominal"
    seed: Annotated[int, tyro.conf.arg(help="What is drawn; another seed is another robot of the same kind.")] = 0
    world: Annotated[
        str,
        tyro.conf.arg(
            metavar="NAME|FILE",
            help=f"What surrounds the robot: {', '.join(ENVIRONMENTS)}, or a mesh of yours (.stl, .obj, .glb).",
        ),
    ] = "free"
    world_scale: Annotated[
        float, tyro.conf.arg(metavar="M", help="Metres per unit of the mesh file: 0.001 for millimetres.")
    ] = 1.0
    world_pose: Annotated[
        tuple[float, float, float, float, float, float],
        tyro.conf.arg(
            metavar="X Y Z A B C",
            help="Where the mesh's origin is, in metres from the port (x right, y down, z ahead), and its turns about "
            "x, y and z in degrees.",
        ),
    ] = NOWHERE_ELSE
    payload: Annotated[float, tyro.conf.arg(metavar="KG", help="What hangs on the tip.")] = 0.0
    gravity: Annotated[
        tuple[float, float, float] | None,
        tyro.conf.arg(metavar="X Y Z", help="In m/s2, as the robot is mounted here; as described by default."),
    ] = None

    def simulation(self) -> Simulation:
        """Raises SimulationError."""
        # Another process may read it, started elsewhere.
        world = str(Path(self.world).absolute()) if Path(self.world).exists() else self.world
        return Simulation(
            twin=self.twin,
            losses=self.losses,
            seed=self.seed,
            world=world,
            world_scale=self.world_scale,
            world_pose=self.world_pose,
            payload_kg=self.payload,
            gravity_m_s2=self.gravity,
        )


AS_DESCRIBED = SimulationArguments()
Simulated = Annotated[SimulationArguments, tyro.conf.arg(name="")]
"""A parameter of this type gives a command all options of the simulation."""


def as_options(simulation: Simulation) -> tuple[str, ...]:
    """The options that say the same on the command line of another process."""
    s = simulation
    gravity = ("--gravity", *map(str, s.gravity_m_s2)) if s.gravity_m_s2 is not None else ()
    return (
        *("--twin", s.twin, "--losses", s.losses, "--seed", str(s.seed)),
        *("--world", s.world, "--world-scale", str(s.world_scale), "--world-pose", *map(str, s.world_pose)),
        *("--payload", str(s.payload_kg), *gravity),
    )


def told_options(simulation: Simulation) -> tuple[str, ...]:
    """Those by which a robot process learns what `Simulation.told` tells, where another process simulates its drives."""
    s = simulation
    return (
        *(("--twin", s.twin) if s.twin != AS_DESCRIBED.twin else ()),
        *(("--losses", s.losses) if s.losses == "off" else ()),
        *(("--gravity", *map(str, s.gravity_m_s2)) if s.gravity_m_s2 is not None else ()),
    )


@dataclass(frozen=True)
class Command:
    """A subcommand. `name` may be of two words: "motors scan"."""

    name: str
    summary: str
    """One line, in lower case."""
    body: Callable[..., int]
    """Typed for tyro; returns the exit status."""
    examples: str
