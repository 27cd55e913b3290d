"""What every control does in every mode of a robot, and each mode in one line: for the page, the README and --help."""

from typing import NamedTuple

from cobra.control.modes.mode import ModeName, modes_of
from cobra.description import RobotDescription


class Line(NamedTuple):
    """One control: on a pad, on the keyboard (empty where it has none), and what it does."""

    pad: str
    keys: str
    does: str


class Guide(NamedTuple):
    """One mode, for people."""

    name: ModeName
    title: str
    help: str
    left: str
    """What the left stick does, in a word or two; empty for nothing. So the others."""
    right: str
    feed: str
    twist: str
    lines: tuple[Line, ...]


_VIEW = Line("Back", "V", "next view that the sticks go by, while nobody drives")
_ALWAYS = (
    Line("D-pad up/down", "− +", "speed: one level up, one level down"),
    Line("A (hold)", "C (hold)", "clutch: the sticks do nothing, until it is let go of and they are centred"),
    Line("Y", "M", "next mode, while nobody drives"),
    _VIEW,
    Line("B", "Esc", "STOP, at any time"),
    Line("Start", "", "arm"),
)


def guides(description: RobotDescription) -> tuple[Guide, ...]:
    """One guide for each mode that the robot offers, in their order: only what this robot has."""
    return tuple(_guide(name, description) for name in modes_of(description))


def pad_map(description: RobotDescription, mode: ModeName = "section") -> tuple[tuple[str, str], ...]:
    """What every control of a pad does in a mode."""
    return tuple((line.pad, line.does) for line in _guide(mode, description).lines)


def _guide(mode: ModeName, d: RobotDescription) -> Guide:
    match mode:
        case "tip":
            return _tip(d)
        case "following":
            return _following(d)
        case "straighten":
            stays = [*_base_moves(d), *_lengthening(d)]
            keep = f", {_and(stays)} {'stays' if len(stays) == 1 else 'stay'}" if stays else ""
            straighten = f"what is bent becomes straight{keep}"
            return Guide(
                mode,
                "Straighten",
                f"Hold to drive: {straighten}. Letting go stops.",
                *("", "", "", ""),
                (_hold("straighten while it is held; letting go stops"), *_always(d)),
            )
        case "pose":
            return Guide(
                mode,
                "Saved pose",
                "Choose a pose, then hold to drive: the robot goes there, all its motions arrive together. Letting go stops.",
                *("", "", "", ""),
                (
                    _hold("go to the chosen pose while it is held; letting go stops"),
                    Line("D-pad left/right", "1 2 3 …", "choose the pose: the one before, the next"),
                    *_always(d),
                ),
            )
        case _:
            return _section(d)


def _section(d: RobotDescription) -> Guide:
    active = d.active_sections
    lines = [_hold()]
    if active:
        lines.append(Line("Left stick", "W A S D", "bend the chosen section; up is up in the chosen view"))
    if any(d.sections[i].elongation for i in active):
        shift = "RB + r" if d.feed else "R"
        lines.append(Line(f"{shift}ight trigger", "" if d.feed else "R", "lengthen the section"))
        lines.append(Line(f"{'RB + l' if d.feed else 'L'}eft trigger", "" if d.feed else "F", "shorten the section"))
        lines.append(Line("X", "", "lock, or unlock; then hold LB until it is done"))
    if len(active) > 1:
        lines.append(Line("Right stick", "arrow keys", "bend the tip section"))
    if d.twist:
        but = "; the right stick then does not bend" if active else ""
        lines.append(Line("RB + right stick left/right", "Q E", f"twist{but}"))
    lines += _feeding(d, "feed in", "feed out")
    if len(active) > 1:
        lines.append(Line("D-pad left/right", "1 2 3 …", "choose the section: towards the base, towards the tip"))
    bends = ["bend one section at a time" if len(active) > 1 else "bend"] if active else []
    moves = [*bends, *(["lengthen"] if _lengthening(d) else []), *_base_moves(d)]
    does = f"{_and(moves).capitalize()}{'' if active else ' the body'}.{_by_hand(d)}"
    return Guide(
        "section",
        "Section" if active else _and(_base_moves(d)).capitalize(),
        does,
        "bend" if active else "",
        "bend" if len(active) > 1 else "",
        "feed" if d.feed else "length" if any(d.sections[i].elongation for i in active) else "",
        "twist" if d.twist else "",
        (*lines, *_always(d)),
    )


def _tip(d: RobotDescription) -> Guide:
    lines = [
        _hold(),
        Line("Left stick", "W A S D", "move the tip across the chosen view; up is up"),
        Line("Right trigger", "R", "advance along the line of sight"),
        Line("Left trigger", "F", "go back along it"),
    ]
    if d.twist:
        lines.append(Line("Right stick left/right", "Q E", "roll the picture"))
    share = "; all sections share the work" if len(d.active_sections) > 1 else ""
    return Guide(
        "tip",
        "Tip",
        f"Move the tip where the stick points{share}. What cannot be reached slows down and stops.",
        "move tip",
        "roll" if d.twist else "",
        "advance",
        "roll" if d.twist else "",
        (*lines, *_always(d)),
    )


def _following(d: RobotDescription) -> Guide:
    lines = [_hold(), Line("Left stick", "W A S D", "steer the tip; the path ahead turns with it")]
    lines += _feeding(d, "feed in: the body follows where the tip has been", "feed out, back along the path")
    return Guide(
        "following",
        "Tip following",
        f"Steer and feed: the body stays on the path of the tip, and comes back along it.{_by_hand(d)}",
        "steer",
        "",
        "feed" if d.feed else "",
        "",
        (*lines, *_always(d)),
    )


def _base_moves(d: RobotDescription) -> list[str]:
    """What drives do with the base."""
    return [word for word, there in (("twist", d.twist), ("feed", d.feed)) if there]


def _by_hand(d: RobotDescription) -> str:
    return " Feed by hand and say how far." if d.hand_fed else ""


def _lengthening(d: RobotDescription) -> list[str]:
    return ["length"] if any(d.sections[i].elongation for i in d.active_sections) else []


def _and(words: list[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _feeding(d: RobotDescription, inwards: str, outwards: str) -> list[Line]:
    return [Line("Right trigger", "R", inwards), Line("Left trigger", "F", outwards)] if d.feed else []


def _always(d: RobotDescription) -> tuple[Line, ...]:
    """What acts in every mode: no view to choose where no stick points anywhere."""
    return tuple(line for line in _ALWAYS if d.active_sections or line is not _VIEW)


def _hold(does: str = "drive while it is held; letting go stops") -> Line:
    return Line("LB (hold)", "Space (hold)", does)
