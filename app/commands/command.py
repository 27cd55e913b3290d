"""What a subcommand is, and the arguments that several of them share."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from cobra.simulation.losses import Losses
from cobra.simulation.options import ENVIRONMENTS, NOWHERE_ELSE, Simulation, TwinKind

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


@dataclass(frozen=True)
class Command:
    """A subcommand. `name` may be of two words: "motors scan"."""

    name: str
    summary: str
    """One line, in lower case."""
    body: Callable[..., int]
    """Typed for tyro; returns the exit status."""
    examples: str
