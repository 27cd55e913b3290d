"""Robots of every kind the description allows: any number of sections and tendons, passive ones, elongating ones."""

import msgspec
import pytest

from cobra.description import Elongation, RobotDescription, Routing
from cobra.loading import load_description


def _routing(section: str, azimuths_deg: tuple[float, ...]) -> Routing:
    names = tuple(f"{section}-{i}" for i in range(len(azimuths_deg)))
    return Routing(names=names, azimuths_deg=azimuths_deg, radius_m=0.0031)


def _elongation(length_m: float) -> Elongation:
    return Elongation(
        range_m=(0.8 * length_m, 1.1 * length_m),
        stiffness_N_m=5136.0,
        rate_m_s=0.02,
        acceleration_m_s2=0.1,
        locked_length_m=0.8 * length_m,
        unlocked_length_m=0.84 * length_m,
    )


def _driven(robot: RobotDescription) -> RobotDescription:
    """The robot with one drive a tendon, as the first, and those of twist and feed where it has them."""
    pattern = robot.drives[0]
    tendons = [
        msgspec.structs.replace(pattern, name=name, tendon=name, address=k + 1)
        for k, name in enumerate(robot.tendon_names)
    ]
    units = {"twist": robot.twist, "feed": robot.feed}
    others = [drive for drive in robot.drives if units.get(drive.moves)]
    return msgspec.structs.replace(robot, drives=(*tendons, *others))


def _robots() -> dict[str, RobotDescription]:
    cobra = load_description("cobra")
    one, two, three = cobra.sections
    replace = msgspec.structs.replace
    passive = replace(two, routing=None, length_m=0.06, name="passive")
    growing = replace(one, elongation=_elongation(0.1), routing=_routing("growing", (0.0, 120.0, 240.0)))
    stretchy = replace(three, elongation=_elongation(0.1), routing=_routing("stretchy", (20.0, 130.0, 250.0, 300.0)))
    robots = {
        "cobra": cobra,
        "by-hand": replace(cobra, twist=None, feed=None),
        "two-by-three": replace(
            cobra,
            sections=(
                replace(one, routing=_routing("a", (10.0, 140.0, 250.0)), length_m=0.08),
                replace(two, routing=_routing("b", (70.0, 190.0, 310.0)), length_m=0.12),
            ),
        ),
        "passive-between": replace(cobra, sections=(one, passive, three)),
        "elongating": replace(cobra, sections=(growing, passive, stretchy), twist=None, feed=None),
        "twist-feed": replace(cobra, sections=tuple(replace(section, routing=None) for section in cobra.sections)),
        "elongating-fed": replace(cobra, sections=(growing, two, stretchy)),
    }
    return {name: _driven(robot) for name, robot in robots.items()}


ROBOTS = _robots()


@pytest.fixture(scope="session")
def cobra() -> RobotDescription:
    return ROBOTS["cobra"]


@pytest.fixture(scope="session", params=list(ROBOTS))
def robot(request: pytest.FixtureRequest) -> RobotDescription:
    return ROBOTS[request.param]


@pytest.fixture(scope="session")
def robots() -> dict[str, RobotDescription]:
    return ROBOTS
