"""`cobra-teleop identify friction`: the guided sweep."""

from pathlib import Path
from typing import Annotated

import tyro

from app.commands.command import AS_DESCRIBED, Command, RobotName, Simulated, as_options


def identify_friction(
    *,
    robot: RobotName = "cobra",
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help="Write the parameters to FILE.")] = None,
    apply: Annotated[bool, tyro.conf.arg(help="Hand them to the running robot, from its next homing on.")] = True,
    simulated: Simulated = AS_DESCRIBED,
) -> int:
    from app.identify_friction import identify_friction as run

    return run(robot, out, apply, as_options(simulated.simulation()))


COMMAND = Command(
    "identify friction",
    "sweep a robot by itself and report stretch, friction and play of its tendons",
    identify_friction,
    "  cobra-teleop identify friction                            the running robot, or COBRA on its twin\n"
    "  cobra-teleop identify friction --losses seeded --seed 3   a twin that is not as described\n"
    "  cobra-teleop identify friction --out losses.toml",
)
