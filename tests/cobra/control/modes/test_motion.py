"""Claims about choosing and switching modes, seen from the robot's loop."""

import math

import numpy as np
import pytest

from cobra.control.motion import NO_POSE
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.loading import load_description
from cobra.messages import HandFedLength, Request, encode
from tests.obedient_bus import ObedientRobot

COBRA = load_description("cobra")
LAYOUT = Configuration(COBRA)
BACKBONE = Backbone(COBRA)
BENT = np.array([0.3, 0.28, 0.4, -0.2, 0.3, 0.5, -0.2, 0.4])


@pytest.fixture
def cobra():
    return ObedientRobot(COBRA, BENT)


@pytest.mark.parametrize("mode", ["tip", "following", "straighten", "pose", "section"])
def test_changing_the_mode_moves_nothing(cobra, mode):
    before = cobra.bus.angles.copy()
    for _ in range(30):
        state = cobra.tick(mode)
    assert (state.mode, state.phase) == (mode, "ready")
    np.testing.assert_allclose(cobra.bus.angles, before, atol=1e-12)
    # Nor does pressing with the sticks centred, but where holding alone is what moves.
    if mode not in ("straighten", "pose"):
        cobra.press(mode)
        cobra.drive(mode, 0.2)
        np.testing.assert_allclose(cobra.bus.angles, before, atol=1e-9)


def test_a_mode_changed_while_driving_ends_the_drive_in_words_and_acts_after_letting_go(cobra):
    cobra.press("section")
    cobra.drive("section", 0.5, primary=(1.0, 0.0))
    state = cobra.tick("tip", held=True, primary=(1.0, 0.0))
    assert (state.phase, state.mode) == ("holding", "section")
    assert "mode was changed while driving" in state.cause
    cobra.drive("tip", 1.0, primary=(1.0, 0.0))
    stood = cobra.q.copy()
    cobra.drive("tip", 0.2, primary=(1.0, 0.0))
    np.testing.assert_array_equal(cobra.q, stood)
    cobra.press("tip")
    cobra.drive("tip", 0.3, primary=(1.0, 0.0))
    assert cobra.state.mode == "tip"
    assert not np.array_equal(cobra.q, stood)


def test_the_ramp_of_the_old_mode_ends_before_the_new_one_moves(cobra):
    """Let go at full speed, choose another mode and press at once: velocity stays continuous."""
    cobra.press("section")
    cobra.drive("section", 1.0, primary=(1.0, 0.0))
    velocity, before = cobra.loop.motion.velocity.copy(), cobra.q.copy()
    for tick in range(100):
        cobra.tick("tip", held=tick > 0, primary=(0.0, 1.0) if tick > 2 else (0.0, 0.0))
        step, before = (cobra.q - before) / cobra.loop.period_s, cobra.q.copy()
        for where in LAYOUT.bends:
            change = math.hypot(*(step - velocity)[where])
            assert change <= LAYOUT.acceleration[where.start] * cobra.loop.period_s * 1.01
        velocity = step
    assert cobra.state.mode == "tip"


def test_a_command_of_an_unknown_mode_is_dropped_and_counted(cobra):
    cobra.press("section")
    sequence = cobra.state.accepted
    state = cobra.tick("warp", held=True)
    assert state.drops["unknown mode"] == 1
    assert state.accepted == sequence
    assert state.mode == "section"


def test_a_borescope_is_offered_only_what_it_can_do():
    borescope = ObedientRobot(load_description("cobra-twist-feed"))
    assert borescope.state.motion.modes == ("section", "pose")
    assert borescope.tick("tip").drops == {"unknown mode": 1}
    borescope.press("section")
    borescope.drive("section", 1.0, twist=1.0, feed=0.5, primary=(1.0, 0.0))
    assert borescope.q[TWIST] > 0.3
    assert borescope.q[FEED] > 0.305
    np.testing.assert_array_equal(borescope.q[2:], 0.0)


# ---------------------------------------------------------------------- going to a shape


def test_straighten_straightens_while_held_and_leaves_twist_and_feed(cobra):
    cobra.press("straighten")
    cobra.drive("straighten", 0.5)
    halfway = cobra.q.copy()
    assert np.linalg.norm(halfway[2:]) > 0.2
    for _ in range(60):
        cobra.tick("straighten")
    stopped = cobra.q.copy()
    cobra.tick("straighten")
    np.testing.assert_array_equal(cobra.q, stopped)
    assert "of bend" in cobra.state.motion.doing.words[0]
    cobra.press("straighten")
    cobra.drive("straighten", 4.0)
    np.testing.assert_allclose(cobra.q[2:], 0.0, atol=1e-6)
    np.testing.assert_array_equal(cobra.q[:2], BENT[:2])
    assert cobra.state.motion.doing.words == ("it is there",)


STARTS = (
    LAYOUT.rest(),
    np.array([0.0, 0.02, 0.0, 0.0, 0.0, 0.0, 0.1, 0.0]),
    np.array([-1.0, 0.6, -0.9, 0.9, 0.8, 0.0, 0.0, -1.2]),
)


@pytest.mark.parametrize("start", STARTS)
def test_a_saved_pose_is_gone_back_to_on_a_straight_way_and_its_entries_arrive_together(cobra, start):
    assert cobra.ask(Request(what="save_pose", name="inspect", lease=cobra.lease)).ok
    assert cobra.state.motion.poses == ("inspect",)
    other = ObedientRobot(COBRA, start)
    other.loop.motion._poses = {"inspect": BENT}
    other.press("pose", pose="inspect")
    other.drive("pose", 1.0, pose="inspect")
    way = BENT - start
    gone = (other.q - start)[np.abs(way) > 1e-9] / way[np.abs(way) > 1e-9]
    if start[FEED] >= 0.3:  # else the port keeps the bends back
        assert gone == pytest.approx(gone[0], abs=0.06)
    other.drive("pose", 30.0, pose="inspect")
    np.testing.assert_allclose(other.q, BENT, atol=1e-6)


def test_going_to_a_pose_needs_one_and_says_so(cobra):
    before = cobra.q.copy()
    cobra.press("pose")
    cobra.drive("pose", 0.5)
    np.testing.assert_array_equal(cobra.q, before)
    assert cobra.state.motion.doing.words == (NO_POSE,)
    # Choosing another one while driving ends the drive, as another mode does.
    assert cobra.tick("pose", held=True, pose="home").phase == "holding"


# ---------------------------------------------------------------------- whose up is up


def test_in_the_fixed_view_right_is_right_however_the_base_is_twisted():
    q = LAYOUT.rest()
    q[TWIST] = math.radians(120)
    for frame, expected in (("world", [1.0, 0.0]), ("base", [math.cos(q[TWIST]), math.sin(q[TWIST])])):
        robot = ObedientRobot(COBRA, q)
        robot.press("section")
        start = BACKBONE.tip(robot.q)[:3, 3]
        robot.drive("section", 0.4, primary=(1.0, 0.0), frame=frame)
        moved = (BACKBONE.tip(robot.q)[:3, 3] - start)[:2]
        np.testing.assert_allclose(moved / np.linalg.norm(moved), expected, atol=1e-6)


@pytest.mark.parametrize("mode", ["section", "following"])
@pytest.mark.parametrize("stick", [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.6)])
def test_in_the_tip_cameras_view_the_view_turns_to_where_the_stick_points(cobra, mode, stick):
    """What is drawn ahead of the camera moves against the stick, whatever bends and twist are before it."""
    cobra.press(mode)
    before = BACKBONE.tip(cobra.q)[:3, :3]
    cobra.drive(mode, 0.4, primary=stick, section=2, frame="tip")
    heading = before.T @ BACKBONE.tip(cobra.q)[:3, 2]
    turned = heading[:2] / np.linalg.norm(heading[:2])
    assert turned @ stick / np.linalg.norm(stick) > math.cos(math.radians(12))


@pytest.mark.parametrize(("frame", "axes"), [("tip", BACKBONE.tip(BENT)[:3, :3]), ("world", np.eye(3))])
def test_in_tip_mode_the_tip_goes_where_the_stick_points_in_the_view(cobra, frame, axes):
    for intent, axis in (({"primary": (1.0, 0.0)}, 0), ({"primary": (0.0, -1.0)}, 1), ({"feed": -1.0}, 2)):
        robot = ObedientRobot(COBRA, BENT)
        robot.press("tip")
        start = BACKBONE.tip(robot.q)[:3, 3]
        robot.drive("tip", 0.3, **intent, speed=0.25, frame=frame)
        moved = axes.T @ (BACKBONE.tip(robot.q)[:3, 3] - start)
        sign = 1.0 if axis == 0 else -1.0
        assert sign * moved[axis] > 0.98 * np.linalg.norm(moved)


# ---------------------------------------------------------------------- following, and feeding by hand


def test_following_tells_path_and_deviation_and_another_mode_forgets_them(cobra):
    cobra.press("following")
    cobra.drive("following", 2.0, primary=(0.4, 0.2), feed=0.4)
    path = cobra.state.motion.doing.path
    points = np.array(path.points).reshape(-1, 3)
    assert path.length_m == pytest.approx(cobra.q[FEED], abs=0.002)
    np.testing.assert_allclose(points[0], 0.0, atol=1e-6)
    assert 0.0 < path.deviation_m <= path.deviation_max_m < 0.01
    assert len(points) <= 60
    cobra.press("section")
    assert cobra.state.motion.doing.path is None


def test_letting_go_in_following_stops_within_the_ramp(cobra):
    cobra.press("following")
    cobra.drive("following", 2.0, primary=(0.9, 0.4), feed=1.0)
    ramp = round(COBRA.teleop.bend_rate_deg_s / COBRA.teleop.bend_acceleration_deg_s2 * 100)
    for _ in range(ramp + 3):
        cobra.tick("following")
    stood = cobra.q.copy()
    for _ in range(50):
        cobra.tick("following")
    np.testing.assert_allclose(cobra.q, stood, atol=1e-6)


def test_a_length_fed_by_hand_is_taken_in_slowly_and_only_while_the_dead_man_is_held():
    robot = ObedientRobot(load_description("cobra-active"))
    robot.press("section")
    robot.drive("section", 3.5, primary=(1.0, 0.0), section=0)
    for _ in range(50):
        robot.tick()
    bent = robot.q.copy()
    assert robot.ask(Request(what="hand_feed", value=0.24, lease=robot.lease)).ok
    for _ in range(50):
        state = robot.tick()
    np.testing.assert_array_equal(robot.q, bent)
    assert state.motion.hand_feed.told_m == 0.24
    assert state.motion.hand_feed.used_m == pytest.approx(0.3)
    robot.press("section")
    before = robot.q[FEED]
    for _ in range(300):
        robot.tick("section", held=True)
        assert abs(robot.q[FEED] - before) <= 0.03 * 0.01 * 1.001
        before = robot.q[FEED]
    assert robot.q[FEED] == pytest.approx(0.24, abs=1e-6)
    base = math.hypot(*robot.q[2:4])
    assert base == pytest.approx(COBRA.sections[0].max_curvature_1_m * 0.04, abs=1e-6), "the port straightened the rest"


def test_a_measuring_device_tells_the_length_without_the_drivers_lease_and_its_silence_is_shown():
    robot = ObedientRobot(load_description("cobra-active"))
    robot.loop.inbox.length(encode(HandFedLength(length_m=0.27)))
    assert robot.tick().motion.hand_feed.source == "measured"
    robot.press("section")
    robot.drive("section", 2.0)
    assert robot.q[FEED] == pytest.approx(0.27, abs=1e-6)
    assert robot.state.motion.hand_feed.source == "silent"
    robot.loop.inbox.length(encode(HandFedLength(length_m=float("nan"))))
    robot.loop.inbox.length(b"\x00")
    drops = robot.tick().drops
    assert drops["length out of range or not asked for"] == drops["malformed length"] == 1


@pytest.mark.parametrize("length", [-0.1, 7.0, float("nan"), float("inf")])
def test_a_length_that_cannot_be_is_refused_in_words(length):
    robot = ObedientRobot(load_description("cobra-active"))
    reply = robot.ask(Request(what="hand_feed", value=length, lease=robot.lease))
    assert not reply.ok
    assert "between 0 and 5000 mm" in reply.reasons[0]


def test_a_robot_with_a_feed_drive_is_told_no_length(cobra):
    reply = cobra.ask(Request(what="hand_feed", value=0.2, lease=cobra.lease))
    assert not reply.ok
    assert "is not fed by hand" in reply.reasons[0]
    assert cobra.state.motion.hand_feed is None


def test_it_cannot_be_armed_while_the_modes_are_being_compiled():
    robot = ObedientRobot(COBRA)
    assert robot.ask(Request(what="disarm", lease=robot.lease)).ok
    robot.loop.preparing = "compiling"
    robot.tick()
    reply = robot.ask(Request(what="arm", lease=robot.lease))
    assert reply.reasons == ("compiling",)
    robot.loop.prepare()
    robot.tick()
    assert robot.ask(Request(what="arm", lease=robot.lease)).ok
