"""The wall: every watched robot at a glance."""

import math
from typing import TypedDict

from app.watching.feeds import Feed, WatchedRobot
from cobra.messages import Phase

STALE_S = 0.5
ALARMS_OF_S = 600.0
"""Alarms of the last minutes are counted on the wall."""


class Alarm(TypedDict):
    text: str
    ago: float
    """Seconds."""


class Tile(TypedDict):
    """One robot."""

    name: str
    present: bool
    fresh: bool
    """States arrive."""
    age_s: float | None
    phase: Phase | None
    cause: str
    driver: str
    since_s: float | None
    tension_N: float | None
    """The highest that is measured."""
    feed_mm: float | None
    alarms: int
    """In the last ten minutes."""
    alarm: Alarm | None
    """The newest of them."""


class Wall(TypedDict):
    robots: list[Tile]
    """By name."""
    troubles: list[str]
    """Endpoints that are not connected, in words."""


def wall_of(robots: dict[str, WatchedRobot], feeds: list[Feed]) -> Wall:
    """What the wall shows now."""
    return Wall(
        robots=[_tile(robots[name]) for name in sorted(robots)],
        troubles=[feed.trouble for feed in feeds if feed.trouble],
    )


def _tile(robot: WatchedRobot) -> Tile:
    state, age = robot.latest(), robot.age()
    alarms: list[Alarm] = []
    if state is not None:
        alarms = [Alarm(text=e.text, ago=state.stamp - e.stamp) for e in tuple(robot.events) if e.level == "alarm"]
        alarms = [alarm for alarm in alarms if alarm["ago"] < ALARMS_OF_S]
    return Tile(
        name=robot.name,
        present=robot.present,
        fresh=robot.present and age < STALE_S,
        age_s=_finite(age),
        phase=state.phase if state else None,
        cause=state.cause if state else "",
        driver=state.lease.holder if state else "",
        since_s=state.stamp - state.lease.since if state and state.lease.holder else None,
        tension_N=_finite(max(filter(math.isfinite, state.drives.load), default=math.nan)) if state else None,
        feed_mm=_finite(state.measured[1] * 1e3) if state and len(state.measured) > 1 else None,
        alarms=len(alarms),
        alarm=alarms[-1] if alarms else None,
    )


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
