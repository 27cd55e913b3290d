"""From the controls of a pad to the driver's intent: dead zone, expo and the map of sticks and buttons. Pure functions."""

import math
from collections.abc import Callable
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

import msgspec
from msgspec import Meta

from app.console.inputs import Button, Controls
from cobra.control.modes.mode import ModeName, modes_of
from cobra.control.modes.stick_frame import StickFrame
from cobra.description import RobotDescription
from cobra.messages import Intent, Pair

Action = Literal["stop", "arm", "lock"]
T = TypeVar("T")

DEAD_MAN: Button = "left_shoulder"
SHIFT: Button = "right_shoulder"
ACTIONS: dict[Button, Action] = {"b": "stop", "start": "arm", "x": "lock"}

CLUTCH: Button = "a"
NEXT_MODE: Button = "y"
NEXT_FRAME: Button = "back"

FRAMES: tuple[StickFrame, ...] = ("world", "base", "tip")
"""Views that the sticks may go by, the first one to begin with: it is that of the 3D view from behind."""

OVERSHOOT = 1e-3
"""A full stick may read this much more than 1, by rounding in a device's own scaling. Anything beyond is a fault."""


class Profile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """How a device's readings are shaped. Fractions of full travel."""

    stick_dead_zone: Annotated[float, Meta(ge=0, le=0.9)] = 0.12
    """Worn sticks come to rest up to a tenth off centre."""
    trigger_dead_zone: Annotated[float, Meta(ge=0, le=0.9)] = 0.05
    expo: Annotated[float, Meta(ge=0, le=1)] = 0.5
    """0: linear. 1: cubic, fine around the centre."""


class Selection(msgspec.Struct, frozen=True):
    """What the driver has chosen and keeps between presses."""

    section: int
    """Index into the description's sections."""
    level: int
    """Index into the description's speed levels."""
    mode: ModeName = "section"
    frame: StickFrame = FRAMES[0]
    pose: str = ""
    """The saved pose to go to."""


class Mapped(NamedTuple):
    """What one reading asks for."""

    intent: Intent
    held: bool
    """The dead-man is held, on a device that is there and reads sound values."""
    selection: Selection
    actions: tuple[Action, ...]
    """Of buttons that went down since the previous reading."""


def first_selection(description: RobotDescription) -> Selection:
    """The base-most section that bends, at the middle speed (the lower one of two)."""
    section = description.active_sections[0] if description.active_sections else 0
    return Selection(section, (len(description.teleop.speed_levels) - 1) // 2)


def rescale(travel: float, dead_zone: float) -> float:
    """0 inside the dead zone, then continuous to 1 at full travel and 1 beyond. `travel` ≥ 0."""
    return min(1.0, max(0.0, travel - dead_zone) / (1.0 - dead_zone))


def expo(travel: float, amount: float) -> float:
    """(1 − e)·r + e·r³ for r in 0…1: gentler around the centre, the same at the end."""
    return (1.0 - amount) * travel + amount * travel**3


def shape_axis(value: float, dead_zone: float, amount: float) -> float:
    """Dead zone and expo of a single axis, odd in its value."""
    return math.copysign(expo(rescale(abs(value), dead_zone), amount), value)


def shape_stick(stick: Pair, dead_zone: float, amount: float) -> Pair:
    """Dead zone and expo by the stick's distance from the centre, so that its direction stays; never longer than 1."""
    distance = math.hypot(*stick)
    if distance <= dead_zone:
        return (0.0, 0.0)
    scale = expo(rescale(distance, dead_zone), amount) / distance
    return (stick[0] * scale, stick[1] * scale)


def fault_of(controls: Controls) -> str | None:
    """Why these readings cannot be trusted, or None."""
    sticks = (*controls.left, *controls.right)
    triggers = (controls.left_trigger, controls.right_trigger)
    if not all(math.isfinite(value) for value in (*sticks, *triggers, controls.stamp)):
        return "not a finite number"
    limit = 1.0 + OVERSHOOT
    if any(abs(value) > limit for value in sticks) or any(not -OVERSHOOT <= value <= limit for value in triggers):
        return "out of range"
    return None


def centred(controls: Controls, profile: Profile) -> bool:
    """Sticks and triggers at rest, inside their dead zones."""
    return (
        math.hypot(*controls.left) <= profile.stick_dead_zone
        and math.hypot(*controls.right) <= profile.stick_dead_zone
        and max(controls.left_trigger, controls.right_trigger) <= profile.trigger_dead_zone
    )


def map_controls(
    controls: Controls,
    previous: Controls,
    selection: Selection,
    profile: Profile,
    description: RobotDescription,
    poses: tuple[str, ...] = (),
) -> Mapped:
    """Turn one reading into what it asks for; buttons act once, when they go down.

    Values that are not finite or out of range, and a device that is gone, ask for no motion and hold nothing. `poses` are
    the saved ones, to choose from in pose mode.
    """
    pressed = controls.buttons - previous.buttons
    chosen = _choose(pressed, selection, description, poses)
    able = {"stop", "arm", *(("lock",) if _changes_length(description) else ())}
    actions = tuple(action for button, action in ACTIONS.items() if button in pressed and action in able)
    at_rest = Intent(
        section=chosen.section,
        speed=description.teleop.speed_levels[chosen.level],
        frame=chosen.frame,
        pose=chosen.pose,
    )
    if not controls.connected or fault_of(controls):
        return Mapped(at_rest, False, chosen, actions)
    held = DEAD_MAN in controls.buttons
    if CLUTCH in controls.buttons:
        return Mapped(at_rest, held, chosen, actions)
    rates = _STICKS[chosen.mode](_Shaped.of(controls, profile), chosen, description)
    return Mapped(msgspec.structs.replace(at_rest, **rates), held, chosen, actions)


class _Shaped(NamedTuple):
    """The sticks and triggers, shaped: what a mode makes rates of."""

    left: Pair
    right: Pair
    turn: float
    """The right stick's left and right alone."""
    pull: float
    """Right trigger less left trigger."""
    shift: bool

    @classmethod
    def of(cls, controls: Controls, profile: Profile) -> "_Shaped":
        left, right = _clip(controls.left), _clip(controls.right)
        bend = (profile.stick_dead_zone, profile.expo)
        pull = (profile.trigger_dead_zone, profile.expo)
        right_pull, left_pull = _clamp(controls.right_trigger, 0.0), _clamp(controls.left_trigger, 0.0)
        return cls(
            left=shape_stick(left, *bend),
            right=shape_stick(right, *bend),
            turn=shape_axis(right[0], *bend),
            pull=shape_axis(right_pull, *pull) - shape_axis(left_pull, *pull),
            shift=SHIFT in controls.buttons,
        )


def _section_rates(sticks: _Shaped, chosen: Selection, d: RobotDescription) -> dict[str, Any]:
    lengthens = d.sections[chosen.section].elongation is not None
    by_length = lengthens and (sticks.shift or d.feed is None)
    return {
        "primary": sticks.left if d.active_sections else (0.0, 0.0),
        "secondary": sticks.right if d.active_sections and not sticks.shift else (0.0, 0.0),
        "feed": sticks.pull if d.feed and not by_length else 0.0,
        "length": sticks.pull if by_length else 0.0,
        "twist": sticks.turn if d.twist and sticks.shift else 0.0,
    }


def _tip_rates(sticks: _Shaped, chosen: Selection, d: RobotDescription) -> dict[str, Any]:
    return {"primary": sticks.left, "feed": sticks.pull, "twist": sticks.turn if d.twist else 0.0}


def _following_rates(sticks: _Shaped, chosen: Selection, d: RobotDescription) -> dict[str, Any]:
    return {"primary": sticks.left, "feed": sticks.pull if d.feed else 0.0}


def _no_rates(sticks: _Shaped, chosen: Selection, d: RobotDescription) -> dict[str, Any]:
    return {}


_STICKS: dict[ModeName, Callable[[_Shaped, Selection, RobotDescription], dict[str, Any]]] = {
    "section": _section_rates,
    "tip": _tip_rates,
    "following": _following_rates,
    "straighten": _no_rates,
    "pose": _no_rates,
}


def _changes_length(description: RobotDescription) -> bool:
    return any(description.sections[i].elongation for i in description.active_sections)


def _choose(
    pressed: frozenset[Button], selection: Selection, description: RobotDescription, poses: tuple[str, ...]
) -> Selection:
    """One step along the sections that bend (in pose mode along the poses) and along the speed levels, whose ends do not
    wrap around; modes and views, each with one button, do."""
    along = ("dpad_right" in pressed) - ("dpad_left" in pressed)
    by_pose = selection.mode == "pose"
    level = selection.level + ("dpad_up" in pressed) - ("dpad_down" in pressed)
    last_level = len(description.teleop.speed_levels) - 1
    return msgspec.structs.replace(
        selection,
        section=_beside(description.active_sections, selection.section, 0 if by_pose else along),
        pose=_beside(poses, selection.pose, along if by_pose else 0),
        level=min(max(level, 0), last_level),
        mode=_next(modes_of(description), selection.mode, NEXT_MODE in pressed),
        frame=_next(FRAMES, selection.frame, NEXT_FRAME in pressed),
    )


def _beside(choices: tuple[T, ...], chosen: T, step: int) -> T:
    """The choice so many steps along; what is none of them is before the first and after the last."""
    if not step or not choices:
        return chosen
    if chosen not in choices:
        return choices[0 if step > 0 else -1]
    return choices[min(max(choices.index(chosen) + step, 0), len(choices) - 1)]


def _next(choices: tuple[T, ...], chosen: T, step: bool) -> T:
    return choices[(choices.index(chosen) + step) % len(choices)]


def _clip(stick: Pair) -> Pair:
    return (_clamp(stick[0]), _clamp(stick[1]))


def _clamp(value: float, low: float = -1.0) -> float:
    return min(max(value, low), 1.0)
