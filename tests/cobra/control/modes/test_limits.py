"""In every mode, whatever the sticks do: bends, rates and tendon travel stay inside their limits at every tick, and what
the drives are told is what the tendon geometry of the commanded shape asks for."""

import math

import msgspec
import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from cobra.control.modes.mode import modes_of
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, Configuration
from cobra.loading import load_description
from tests.obedient_bus import ObedientRobot

COBRA = load_description("cobra")
ACTIVE = load_description("cobra-active")
BORESCOPE = load_description("cobra-twist-feed")
SHORT = msgspec.structs.replace(
    COBRA,
    drives=tuple(
        msgspec.structs.replace(drive, travel_range=(-0.005, 0.004)) if drive.moves == "tendon" else drive
        for drive in COBRA.drives
    ),
)
"""Its tendons end long before its bends do."""
ROBOTS = {"cobra": COBRA, "cobra-active": ACTIVE, "cobra-twist-feed": BORESCOPE, "short tendons": SHORT}
DT = 0.01


def tendon_lengths(robot, q):
    """Length changes of the tendons from where their holes are: chords through the vertebrae, not the linear map."""
    backbone, chords = Backbone(robot), 3000
    shapes = [backbone.points(shape, chords + 1) for shape in (backbone.configuration.rest(), q)]
    out = []
    for section in (i for i, s in enumerate(robot.sections) if s.routing):
        end = round(chords * sum(s.length_m for s in robot.sections[: section + 1]) / robot.active_length_m)
        routing = robot.sections[section].routing
        for azimuth in np.radians(routing.azimuths_deg):
            hole = routing.radius_m * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
            rest, now = (
                np.linalg.norm(np.diff((s.positions + s.rotations @ hole)[: end + 1], axis=0), axis=1).sum()
                for s in shapes
            )
            out.append(now - rest)
    return np.array(out)


unit = st.floats(-1, 1)
sticks = st.tuples(unit, unit).filter(lambda stick: math.hypot(*stick) <= 1.0)
motions = st.fixed_dictionaries(
    {
        "primary": sticks,
        "secondary": sticks,
        "feed": st.sampled_from([-1.0, -0.4, 0.0, 0.4, 1.0]),
        "twist": st.sampled_from([-1.0, 0.0, 0.5]),
        "section": st.integers(0, 2),
        "speed": st.sampled_from([0.25, 1.0]),
        "frame": st.sampled_from(["world", "base", "tip"]),
    }
)
pieces = st.tuples(st.sampled_from(modes_of(COBRA)), st.booleans(), motions, st.integers(5, 70))


@pytest.mark.parametrize("name", ROBOTS)
@settings(max_examples=10, deadline=None, phases=[Phase.explicit, Phase.reuse, Phase.generate])
@given(history=st.lists(pieces, min_size=3, max_size=8), feed_m=st.sampled_from([0.04, 0.17, 0.3]), hand=st.booleans())
def test_limits_hold_at_every_tick_in_every_mode_whatever_the_sticks_do(name, history, feed_m, hand):
    robot = ROBOTS[name]
    layout, backbone = Configuration(robot), Backbone(robot)
    start = layout.rest()
    start[FEED] = feed_m
    machine = ObedientRobot(robot, start)
    machine.loop.motion._poses = {"home": start, "bent": layout.rest() + np.where(layout.rate > 0.0, 0.3, 0.0)}
    low = np.array([drive.travel_limits[0] for drive in robot.drives])
    high = np.array([drive.travel_limits[1] for drive in robot.drives])
    speed = np.array([robot.motor_of(d).max_speed_rad_s * abs(d.travel_per_rad) for d in robot.drives])
    transmission = machine.loop.drivetrain.transmission
    setpoint = np.array(machine.state.drives.setpoint)
    for mode, held, intent, ticks in history:
        if mode not in machine.loop.motion.names:
            continue
        if hand and robot.feed is None:
            machine.loop.motion.hand_feed.tell(0.3 * abs(intent["primary"][0]))
        if held:
            machine.press(mode, pose="bent" if intent["twist"] else "home")
            setpoint = np.array(machine.state.drives.setpoint)
        for _ in range(ticks):
            q = machine.q.copy()
            machine.tick(mode, held, **intent, pose="bent" if intent["twist"] else "home")
            there = machine.q
            assert np.all(np.isfinite(there))
            assert np.all((layout.low - 1e-12 <= there) & (there <= layout.high + 1e-12))
            for where, limit in zip(layout.bends, backbone.bend_limits(there), strict=True):
                assert math.hypot(*there[where]) <= limit + 1e-9
                assert math.hypot(*(there - q)[where]) <= layout.rate[where.start] * DT * (1 + 1e-6) + 1e-12
            still = layout.rate == 0.0
            still[FEED] = False
            assert np.array_equal(there[still], q[still]), "what no drive moves stays"
            step, setpoint = np.array(machine.state.drives.setpoint) - setpoint, np.array(machine.state.drives.setpoint)
            assert np.all((low - 1e-12 <= setpoint) & (setpoint <= high + 1e-12))
            assert np.all(np.abs(step) <= speed * DT * (1 + 1e-6) + 1e-12)
        machine.tick(mode)
    travel = transmission.travel(machine.bus.angles)[list(robot.tendon_drives)]
    # The chord in which the body bends at the port errs by r κ h / 2 = 3 µm.
    assert travel == pytest.approx(tendon_lengths(robot, machine.q), abs=5e-6)
