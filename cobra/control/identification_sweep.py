"""The guided sweep that shows a robot's losses: pretension up and down, every section bent to and fro, sections together."""

from collections.abc import Iterator
from typing import NamedTuple

from cobra.description import RobotDescription
from cobra.messages import Intent

SPEED = 0.6
SWING_DEG = 45.0
PAUSE_S = 0.3
LEVELS = (1.5, 0.6, 1.0)
"""Of the pretension, one after the other."""
LEVEL_S = 4.0


class Step(NamedTuple):
    """What to do for a while."""

    seconds: float
    intent: Intent | None
    """None: stand still, dead-man let go."""
    pretension_N: float | None = None
    words: str = ""


def steps(description: RobotDescription) -> Iterator[Step]:
    """The sweep of one robot, in order."""
    tendon = description.tendon
    assert tendon is not None
    for share in LEVELS:
        level = min(max(share * tendon.pretension_N, 3.0 * tendon.min_tension_N), 0.7 * tendon.max_tension_N)
        yield Step(LEVEL_S, None, level, f"pretension {level:.0f} N")
    turn = SWING_DEG / (SPEED * description.teleop.bend_rate_deg_s)
    active = description.active_sections
    for section in active:
        name = description.sections[section].name
        for axis in ((1.0, 0.0), (0.0, 1.0)):
            yield from _swing(section, axis, turn, f"section {name}, {'left and right' if axis[0] else 'up and down'}")
    for section in active[1:]:
        # With the first section aside the weight bends the others: that tells the scale of their radii.
        first = active[0]
        yield Step(turn, _bend(first, (0.7, 0.7)), words=f"section {description.sections[first].name} aside")
        yield from _swing(section, (0.7, 0.7), turn, f"section {description.sections[section].name} beyond it")
        yield Step(turn, _bend(first, (-0.7, -0.7)), words="back")
        yield Step(PAUSE_S, None)


def _swing(section: int, axis: tuple[float, float], turn: float, words: str) -> Iterator[Step]:
    for sign, times in ((1.0, 1.0), (-1.0, 2.0), (1.0, 1.0)):
        yield Step(turn * times, _bend(section, (sign * axis[0], sign * axis[1])), words=words)
    yield Step(PAUSE_S, None, words=words)


def _bend(section: int, direction: tuple[float, float]) -> Intent:
    return Intent(primary=direction, section=section, speed=SPEED)
