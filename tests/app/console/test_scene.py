"""The 3D view draws what the robot measured, in few messages, and says when it does not know."""

import math

import numpy as np
import pytest
import viser

from app.console import appearance
from app.console.scene import GHOST_SCALE, MESSAGES_PER_FRAME, TRAIL_S, BadStateError, Scene
from app.console.surroundings import first_camera, up_direction
from cobra.messages import Tendons
from tests.app.console.scene_fakes import (
    COBRA,
    bend_of,
    drives_of,
    elongating,
    hanging_the_other_way,
    state_of,
    without_tendons,
)


@pytest.fixture(scope="module")
def server():
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def scene(server):
    scene = Scene(server, COBRA)
    scene.start()
    yield scene
    scene.stop()


def node(server, name):
    handle = server.scene.get_handle_by_name(name)
    assert handle is not None
    return handle


def messages(server):
    """Messages that every client has been sent so far."""
    return server._websock_server._broadcast_buffer.message_counter


def moving(t):
    loads = tuple(10.0 + 9.0 * math.sin(3.0 * t + i) for i in range(len(COBRA.drives)))
    return state_of(t=t, drives=drives_of(COBRA, load=loads))


def test_a_frame_costs_at_most_eight_messages_whatever_moves(server, scene):
    scene.update(moving(0.0))
    costs = []
    for frame in range(1, 91):
        before = messages(server)
        scene.update(moving(frame / 30.0))
        costs.append(messages(server) - before)
    assert max(costs) <= MESSAGES_PER_FRAME == 8
    assert min(costs) >= 6


def test_a_robot_that_stands_still_costs_nothing(server, scene):
    for frame in range(4):
        scene.update(state_of(stamp=1000.0 + frame / 30.0))
    before = messages(server)
    for frame in range(4, 10):
        scene.update(state_of(stamp=1000.0 + frame / 30.0))
    assert messages(server) == before


def test_the_body_is_what_was_measured_and_the_ghost_what_was_commanded(server, scene):
    state = state_of(t=1.3)
    scene.update(state)
    measured, commanded = np.array(state.measured), np.array(state.commanded)
    pose = scene.body.pose(measured)
    np.testing.assert_allclose(node(server, "/tube").vertices, pose.tube, atol=1e-6)
    np.testing.assert_allclose(node(server, "/tendons").points, pose.tendons, atol=1e-6)
    np.testing.assert_allclose(node(server, "/vertebrae").batched_positions, pose.vertebrae, atol=1e-6)
    ghost = node(server, "/ghost")
    assert ghost.visible
    np.testing.assert_allclose(ghost.vertices, scene.body.tube(commanded, GHOST_SCALE), atol=1e-6)
    np.testing.assert_allclose(scene.tip_position, scene.body.backbone.tip(measured)[:3, 3], atol=1e-12)


def test_the_view_cone_opens_from_the_tip_along_its_axis(server, scene):
    state = state_of(t=1.3)
    scene.update(state)
    tip = scene.body.backbone.tip(np.array(state.measured))
    away = node(server, "/frame/cone").vertices - tip[:3, 3]
    along = away @ tip[:3, 2]
    assert along.min() > 0.0
    np.testing.assert_allclose(away.mean(axis=0) / np.linalg.norm(away.mean(axis=0)), tip[:3, 2], atol=1e-4)
    axes = node(server, "/frame/axes").points
    np.testing.assert_allclose((axes[:, 1] - axes[:, 0]) / (3.0 * scene.body.radius_m), tip[:3, :3].T, atol=1e-4)


def test_without_a_command_there_is_no_ghost(server, scene):
    scene.update(state_of(commanded=()))
    assert not node(server, "/ghost").visible


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"measured": (0.0,) * 7}, "measured: 7 entries, 8 are needed"),
        ({"measured": (*bend_of(COBRA, 0.0)[:7], math.nan)}, "measured: not finite"),
        ({"measured": (*bend_of(COBRA, 0.0)[:7], math.inf)}, "measured: not finite"),
        ({"commanded": (0.0,) * 9}, "commanded: 9 entries, 8 are needed"),
        ({"commanded": (math.nan,) * 8}, "commanded: not finite"),
        ({"drives": drives_of(COBRA, load=(1.0,) * 13)}, "drives.load: 13 entries, 14 are needed"),
        ({"drives": drives_of(COBRA, fault=())}, "drives.fault: 0 entries, 14 are needed"),
    ],
)
def test_a_bad_state_is_refused_and_nothing_of_it_is_drawn(server, scene, changes, said):
    scene.update(state_of(t=0.0))
    before = messages(server)
    with pytest.raises(BadStateError, match=said):
        scene.update(state_of(t=1.0, **changes))
    assert messages(server) == before
    scene.update(state_of(t=2.0))
    assert messages(server) > before


def test_a_tendons_colour_is_that_of_its_own_drive(server, scene):
    slack, tight = 0.0, COBRA.tendon.max_tension_N
    for i, name in enumerate(COBRA.tendon_names):
        loads = [slack] * len(COBRA.drives)
        loads[COBRA.tendon_drives[i]] = tight
        for frame in range(3):
            scene.update(state_of(stamp=1000.0 + frame, drives=drives_of(COBRA, load=tuple(loads))))
        colors = node(server, "/tendons").colors.astype(int)
        warm = (colors[:, :, 0] > colors[:, :, 2]).all(axis=1)
        np.testing.assert_array_equal(warm, scene.body.segment_tendon == i, err_msg=name)


def test_a_tendon_is_drawn_cooler_where_friction_has_taken_its_tension_away(server, scene):
    limit, drop = COBRA.tendon.max_tension_N, 0.8
    ends = np.array([0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2])
    rows = [[limit, *limit * drop ** np.arange(1.0, 3.0 + end), *[math.nan] * (2 - end)] for end in ends]
    for frame in range(3):
        tendons = Tendons(tension=(limit,) * 12, profile=tuple(tuple(row) for row in rows))
        scene.update(state_of(stamp=1000.0 + frame, tendons=tendons))
    colors = node(server, "/tendons").colors[:, 0].astype(int)
    warmth = colors[:, 0] - colors[:, 2]
    for i, end in enumerate(ends):
        own = warmth[scene.body.segment_tendon == i]
        assert (np.diff(own) <= 0).all()
        assert own[0] > own[-1], COBRA.tendon_names[i]
        # It ends as warm as the tension there.
        last = appearance.linear(appearance.tension_colors(np.array([rows[i][2 + end]]), limit))[0].astype(int)
        assert own[-1] == pytest.approx(last[0] - last[2], abs=6)


def test_colours_grow_warmer_with_tension_and_no_further_beyond_the_limit():
    colors = appearance.tension_colors(np.linspace(0.0, 40.0, 200), 40.0).astype(int)
    warmth = colors[:, 0] - colors[:, 2]
    assert (np.diff(warmth) >= 0).all()
    assert (np.diff(warmth[::10]) > 0).all()
    beyond = appearance.tension_colors(np.array([-3.0, 0.0, 40.0, 90.0, math.nan]), 40.0)
    np.testing.assert_array_equal(beyond[0], beyond[1])
    np.testing.assert_array_equal(beyond[2], beyond[3])
    np.testing.assert_array_equal(beyond[4], appearance.STALE)


def looks_alive(server):
    return node(server, "/tube").color == appearance.TUBE and not node(server, "/notice").visible


def test_old_data_turn_the_robot_grey_until_new_ones_come(server, scene):
    scene.update(state_of())
    assert looks_alive(server)
    scene.show_stale(1.26)
    assert not looks_alive(server)
    assert node(server, "/notice").text == "no data for 1.3 s"
    grey = appearance.linear(appearance.STALE)
    assert (node(server, "/tendons").colors == grey).all()
    assert (node(server, "/vertebrae").batched_colors == grey).all()
    scene.update(state_of())
    assert looks_alive(server)
    assert not (node(server, "/tendons").colors == grey).all()


def test_before_homing_the_shape_is_drawn_as_a_guess(server, scene):
    assert node(server, "/notice").text == "waiting for the robot"
    scene.update(state_of(homed=False))
    assert not looks_alive(server)
    assert "not homed" in node(server, "/notice").text
    scene.update(state_of(measured=()))
    assert not looks_alive(server)
    scene.update(state_of())
    assert looks_alive(server)


def test_the_trail_is_the_tips_path_of_the_last_twenty_seconds(server, scene):
    times = np.arange(0.0, 30.0, 0.1)
    for t in times:
        scene.update(state_of(t=float(t)))
    points = node(server, "/trail").points
    path = np.array([scene.body.backbone.tip(np.array(bend_of(COBRA, t)))[:3, 3] for t in times])
    reach = np.linalg.norm(path[:, None] - points[0, 0], axis=2).min(axis=1)
    since = times[-1] - times[np.argmin(reach)]
    assert since == pytest.approx(TRAIL_S, abs=0.5)
    np.testing.assert_allclose(points[1:, 0], points[:-1, 1])
    assert np.linalg.norm(points[-1, 1] - path[-3:], axis=1).min() < 1e-6


def test_a_guessed_shape_leaves_no_trail(server, scene):
    for t in np.arange(0.0, 3.0, 0.1):
        scene.update(state_of(t=float(t), homed=False))
    for stamp in (1004.0, 1004.1, 1004.2):
        scene.update(state_of(t=9.0, stamp=stamp))
    assert np.ptp(node(server, "/trail").points.reshape(-1, 3), axis=0).max() < 1e-9


def test_a_robot_that_starts_anew_leaves_no_line_from_its_last_life(server, scene):
    for t in np.arange(0.0, 5.0, 0.1):
        scene.update(state_of(t=float(t)))
    for stamp in (3.0, 3.1, 3.2):
        scene.update(state_of(t=9.0, stamp=stamp))
    points = node(server, "/trail").points
    assert np.ptp(points.reshape(-1, 3), axis=0).max() < 1e-9


@pytest.mark.parametrize("description", [without_tendons(), elongating()], ids=["without-tendons", "elongating"])
def test_other_robots_are_drawn_by_the_same_code(server, description):
    scene = Scene(server, description)
    scene.start()
    count = len(description.drives)
    for t in (0.0, 0.1, 0.2):
        scene.update(state_of(description, t=t, drives=drives_of(description, load=(3.0,) * count)))
    assert looks_alive(server)
    assert (server.scene.get_handle_by_name("/tendons") is None) == (not description.tendon_names)
    scene.stop()
    assert server.scene.get_handle_by_name("/tube") is None


@pytest.mark.parametrize("description", [COBRA, hanging_the_other_way()], ids=["hanging", "sideways"])
def test_up_is_away_from_gravity_and_the_whole_robot_is_in_the_first_view(description):
    up = up_direction(description)
    assert up @ np.array(description.backbone.gravity_m_s2) == pytest.approx(-9.81)
    position, look_at = first_camera(description)
    ahead = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(ahead, up)
    right /= np.linalg.norm(right)
    assert right[0] > 0.5, "+x is to the right, as on the stick"
    for z in (0.0, 0.15, 0.30):
        seen = np.array([0.0, 0.0, z]) - position
        depth = seen @ ahead
        assert abs(seen @ np.cross(right, ahead)) < depth * math.tan(0.35)
        assert abs(seen @ right) < 1.3 * depth * math.tan(0.35)
