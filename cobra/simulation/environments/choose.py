"""The environment that a name or a file stands for."""

from collections.abc import Callable
from pathlib import Path

from cobra.description import RobotDescription
from cobra.simulation.environments.engine import engine_stage
from cobra.simulation.environments.mesh_file import from_file
from cobra.simulation.environments.pipes import bent_pipe, straight_pipe
from cobra.simulation.environments.surface import Environment

GENERATED: dict[str, Callable[[RobotDescription], Environment]] = {
    "straight-pipe": straight_pipe,
    "bent-pipe": bent_pipe,
    "engine-stage": engine_stage,
}


def environment(
    world: str, d: RobotDescription, scale: float = 1.0, pose: tuple[float, ...] = (0.0,) * 6
) -> Environment | None:
    """Walls for a robot: one of `options.ENVIRONMENTS`, made to its measure, or a mesh file; None is free space.

    Raises:
        WallsError: the mesh cannot be used.
    """
    if world == "free":
        return None
    if world in GENERATED:
        return GENERATED[world](d)
    return from_file(Path(world), d, scale, pose)
