"""The twin bends as constant curvature says, carries real tension, cannot push, and is held straight behind the port."""

import threading
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.simulation.losses import with_losses
from cobra.simulation.twin import Twin, build_twin
from tests.cobra.simulation.references import arc_chain, shortening

COBRA = with_losses(load_description("cobra"), "off", 0)
LENGTHS = [section.length_m for section in COBRA.sections]
MAX_BEND = COBRA.sections[0].max_bend_rad
PRETENSION_N = 8.0
FEED, TWIST = COBRA.feed_drive, COBRA.twist_drive
QUARTERS = {"E": (1.0, 0.0), "S": (0.0, 1.0), "W": (-1.0, 0.0), "N": (0.0, -1.0)}


def travel_for(twin: Twin, bends: np.ndarray, tension_N: float = PRETENSION_N, feed_m: float = 0.3) -> np.ndarray:
    """Travel that the geometry asks for, with every tendon wound to this tension in the straight robot."""
    d = twin.description
    travel = np.zeros(len(d.drives))
    travel[list(d.tendon_drives)] = -shortening(d, bends) - tension_N / twin.chain.tendon_stiffness
    if d.feed_drive is not None:
        travel[d.feed_drive] = feed_m
    return travel


def settled(twin: Twin, travel: np.ndarray) -> np.ndarray:
    """Go there within half a second, rest, and return the loads."""
    twin.advance(travel, 0.5)
    return twin.advance(travel, 1.0)


def bent(kind: str = "ideal", description: RobotDescription = COBRA, **bends: tuple[float, float]) -> Twin:
    twin = build_twin(description, kind)  # type: ignore[arg-type]
    wanted = np.array([bends.get(section.name, (0.0, 0.0)) for section in description.sections])
    settled(twin, travel_for(twin, wanted))
    return twin


def with_gravity(gravity: tuple[float, float, float]) -> RobotDescription:
    return replace(COBRA, backbone=replace(COBRA.backbone, gravity_m_s2=gravity))


def random_bends(count: int, seed: int = 3) -> np.ndarray:
    """(count, 3, 2), evenly over the discs of allowed bends."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 2 * np.pi, (count, 3))
    size = MAX_BEND * np.sqrt(rng.uniform(0.0, 1.0, (count, 3)))
    return np.stack([size * np.cos(angle), size * np.sin(angle)], axis=-1)


def test_the_ideal_twin_takes_the_shape_that_its_tendons_are_wound_for() -> None:
    twin = build_twin(COBRA, "ideal")
    bend_errors, tip_errors = [], []
    for bends in random_bends(12):
        settled(twin, travel_for(twin, bends))
        truth = twin.truth()
        _, tip = arc_chain(bends, LENGTHS)
        bend_errors.append(np.linalg.norm(truth.bends - bends, axis=1).max() / MAX_BEND)
        tip_errors.append(np.linalg.norm(truth.tip_position - tip) / sum(LENGTHS))
    print(f"bend error {100 * max(bend_errors):.2f} % of 90 degrees, tip error {100 * max(tip_errors):.2f} % of length")
    assert max(bend_errors) < 0.02
    assert max(tip_errors) < 0.02


def test_the_tips_orientation_is_that_of_constant_curvature_without_twist() -> None:
    bends = {"base": (0.6, 0.5), "middle": (-0.4, 0.9), "tip": (0.7, -0.7)}
    truth = bent(**bends).truth()
    rotation, _ = arc_chain(np.array(list(bends.values())), LENGTHS)
    measured = np.empty(9)
    mujoco.mju_quat2Mat(measured, truth.tip_wxyz)
    angle = np.arccos((np.trace(rotation.T @ measured.reshape(3, 3)) - 1) / 2)
    assert np.degrees(angle) < 2.0


@pytest.mark.parametrize("bends", random_bends(6, seed=11))
def test_tendon_lengths_of_a_constant_curvature_pose_are_those_of_c4(bends: np.ndarray) -> None:
    twin = build_twin(COBRA, "ideal")
    model, data = twin.chain.model, mujoco.MjData(twin.chain.model)
    for spring, joint in zip(twin.chain.springs, twin.chain.joints, strict=True):
        if spring.does in ("bend_x", "bend_y"):
            section = COBRA.sections[spring.section]
            data.qpos[joint] = bends[spring.section][int(spring.does == "bend_y")] / section.vertebrae
    mujoco.mj_forward(model, data)
    change = data.actuator_length[list(COBRA.tendon_drives)] - twin.chain.tendon_rest
    # Straight across the gaps instead of along the arc: 1.1 % of what 90 degrees wind, for each section crossed.
    across_gaps = 0.011 * 0.0033 * MAX_BEND * (np.array(COBRA.tendon_section) + 1)
    assert (np.abs(change + shortening(COBRA, bends)) < across_gaps).all()


def test_a_straight_ideal_robot_carries_its_pretension_and_reaches_straight_ahead() -> None:
    twin = build_twin(COBRA, "ideal")
    loads = settled(twin, travel_for(twin, np.zeros((3, 2))))
    np.testing.assert_allclose(loads[:12], PRETENSION_N, rtol=1e-6)
    np.testing.assert_allclose(twin.truth().tip_position, [0.0, 0.0, 0.3], atol=1e-9)


def test_it_answers_alike_in_all_four_directions() -> None:
    reach = [bent(base=(0.9 * x, 0.9 * y), tip=(0.5 * x, 0.5 * y)).truth().tip_position for x, y in QUARTERS.values()]
    for (x, y), tip in zip(QUARTERS.values(), reach, strict=True):
        assert tip[:2] @ (x, y) == pytest.approx(reach[0][0], abs=2e-6)
        assert tip[:2] @ (-y, x) == pytest.approx(0.0, abs=2e-6)


@pytest.mark.parametrize("middle", [1.0, -1.0], ids=["C", "S"])
def test_ninety_degrees_a_section_need_less_than_the_maximum_tension(middle: float) -> None:
    assert COBRA.tendon
    twin = build_twin(COBRA, "ideal")
    loads = settled(twin, travel_for(twin, MAX_BEND * np.array([[1.0, 0.0], [middle, 0.0], [1.0, 0.0]])))
    print(f"largest tension at 90 degrees a section {loads[:12].max():.1f} N")
    assert loads[:12].max() < 0.5 * COBRA.tendon.max_tension_N


def test_it_settles_within_half_a_second() -> None:
    twin = bent("default")
    start = twin.truth().tip_position
    travel = travel_for(twin, np.array([[0.5, 0.0]] * 3))
    early, late = [(twin.advance(travel, s), twin.truth().tip_position)[1] for s in (0.5, 4.0)]
    assert np.linalg.norm(early - late) < 0.05 * np.linalg.norm(late - start)


def test_a_tendon_paid_out_is_slack_and_has_exactly_no_tension() -> None:
    twin = bent()
    travel = travel_for(twin, np.zeros((3, 2)))
    for target in (0.004, 0.0, 0.004):  # also while it is moving, when damping alone could push
        start = travel[0]
        for step in np.linspace(0.0, 1.0, 20):
            travel[0] = start + step * (target - start)
            assert (twin.advance(travel, 0.005)[:12] >= 0.0).all()
    assert twin.advance(travel, 0.1)[0] == 0.0
    assert twin.truth().tensions[0] == 0.0


def test_what_a_section_lacks_in_bend_its_tendons_have_gained_in_length() -> None:
    twin = build_twin(with_gravity((0.0, 0.0, 0.0)), "default")
    before = settled(twin, travel_for(twin, np.zeros((3, 2))))
    after = settled(twin, travel_for(twin, np.array([[0.0, 0.0], [0.0, 0.0], [0.6, 0.3]])))
    lacking = shortening(COBRA, np.array([[0.0, 0.0], [0.0, 0.0], [0.6, 0.3]]) - twin.truth().bends)
    stretch = (after - before)[:12] / twin.chain.tendon_stiffness
    np.testing.assert_allclose(lacking, stretch, atol=0.02 * np.abs(stretch).max())
    degrees = np.degrees(1 / twin.chain.tendon_stiffness / 0.0033)
    print(f"stretch over 5 m takes {degrees.min():.1f} to {degrees.max():.1f} degrees of section bend a newton")
    assert ((degrees > 8) & (degrees < 10)).all()


def test_gravity_pulls_the_default_twin_down_and_the_ideal_one_nowhere() -> None:
    level = with_gravity((0.0, 9.81, 0.0))
    droop = bent("default", level).truth().tip_position
    assert 0.005 < droop[1] < 0.06
    assert abs(droop[0]) < 1e-6
    np.testing.assert_allclose(bent("ideal", level).truth().tip_position, [0.0, 0.0, 0.3], atol=1e-6)


def test_how_far_stretch_and_gravity_take_the_tip_from_the_model() -> None:
    for name, gravity in {
        "hanging": (0.0, 0.0, 9.81),
        "level": (0.0, 9.81, 0.0),
        "weightless": (0.0, 0.0, 0.0),
    }.items():
        twin = build_twin(with_gravity(gravity), "default")
        errors = []
        for bends in random_bends(4):
            settled(twin, travel_for(twin, bends))
            errors.append(np.linalg.norm(twin.truth().tip_position - arc_chain(bends, LENGTHS)[1]))
        print(f"default twin, {name}: tip off by {1e3 * np.mean(errors):.0f} mm mean, {1e3 * max(errors):.0f} mm max")
        assert 0.01 < np.mean(errors) < 0.15
        assert twin.recoveries == 0


def test_behind_the_port_it_is_straight_however_far_it_is_retracted_and_whatever_is_pulled() -> None:
    twin = bent(base=(1.2, 0.3), middle=(-0.5, 0.9), tip=(0.3, -1.0))
    wanted = np.array([[1.2, 0.3], [-0.5, 0.9], [0.3, -1.0]])
    worst, bend_error = 0.0, 0.0
    for feed in np.linspace(0.3, 0.0, 400):
        exposed = np.clip(feed - np.array([0.2, 0.1, 0.0]), 0.0, 0.1)
        twin.advance(travel_for(twin, wanted * exposed[:, None] / 0.1, feed_m=feed), 0.025)
        truth = twin.truth()
        behind = truth.vertebrae[truth.vertebrae[:, 2] < 0.0]
        worst = max(worst, np.hypot(*behind[:, :2].T).max(initial=0.0))
        bend_error = max(bend_error, np.abs(truth.bends - wanted * exposed[:, None] / 0.1).max() / MAX_BEND)
    print(
        f"behind the port at most {1e3 * worst:.2f} mm off the axis; bends within {100 * bend_error:.1f} % of 90 degrees"
    )
    assert worst < 0.0003
    assert bend_error < 0.02
    assert twin.recoveries == 0


def test_bends_are_made_over_the_exposed_length_only() -> None:
    twin = build_twin(COBRA, "ideal")
    bends = np.array([[0.0, 0.0], [0.3, 0.5], [-0.8, 0.4]])
    settled(twin, travel_for(twin, bends, feed_m=0.134))
    _, tip = arc_chain(bends, [0.0, 0.034, 0.1])
    np.testing.assert_allclose(twin.truth().tip_position, tip, atol=0.001)
    np.testing.assert_allclose(twin.truth().bends, bends, atol=0.02)


def test_without_a_feed_everything_is_exposed() -> None:
    drives = tuple(drive for drive in COBRA.drives if drive.moves == "tendon")
    bends = np.array([[0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
    twin = build_twin(replace(COBRA, feed=None, twist=None, drives=drives), "ideal")
    settled(twin, travel_for(twin, bends))
    np.testing.assert_allclose(twin.truth().tip_position, arc_chain(bends, LENGTHS)[1], atol=0.003)


def test_twist_turns_the_bent_body_to_the_right_and_feed_moves_it_ahead() -> None:
    twin = bent(base=(1.0, 0.0))
    before = twin.truth().tip_position
    travel = travel_for(twin, np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 0.0]]), feed_m=0.4)
    travel[TWIST] = np.pi / 2
    twin.advance(travel, 2.0)
    twin.advance(travel, 1.0)
    x, y, z = before
    np.testing.assert_allclose(twin.truth().tip_position, [-y, x, z + 0.1], atol=1e-4)


def test_the_feed_drive_carries_a_hanging_body() -> None:
    twin = bent("default", with_gravity((0.0, 0.0, 9.81)))
    loads = settled(twin, travel_for(twin, np.zeros((3, 2))))
    assert loads[FEED] == pytest.approx(-5.0 * 0.04 * 9.81, rel=1e-3)


def test_a_robot_of_twist_and_feed_alone_needs_no_tendons() -> None:
    sections = tuple(replace(section, routing=None) for section in COBRA.sections)
    drives = tuple(drive for drive in COBRA.drives if drive.moves != "tendon")
    twin = build_twin(replace(COBRA, sections=sections, drives=drives, tendon=None))
    twin.advance(np.array([0.0, 0.3]), 0.0)
    twin.advance(np.array([1.0, 0.35]), 1.0)
    twin.advance(np.array([1.0, 0.35]), 1.0)
    truth = twin.truth()
    assert truth.tensions.shape == (0,)
    assert truth.tip_position[2] == pytest.approx(0.35, abs=0.001)
    assert 2 * np.arctan2(truth.tip_wxyz[3], truth.tip_wxyz[0]) == pytest.approx(1.0, abs=1e-3)


def test_a_passive_section_between_active_ones_bends_with_what_passes_through_it() -> None:
    passive = replace(COBRA.sections[1], routing=None)
    drives = tuple(d for d in COBRA.drives if d.tendon not in ("S2", "E2", "N2", "W2"))
    robot = replace(COBRA, sections=(COBRA.sections[0], passive, COBRA.sections[2]), drives=drives)
    twin = bent("ideal", robot, tip=(0.8, 0.0))
    base, middle, tip = twin.truth().bends
    # The tip's tendons lead through all three; the base's own hold it, so passive and tip share what was wound.
    np.testing.assert_allclose(base, 0.0, atol=0.02)
    np.testing.assert_allclose(middle, tip, atol=0.02)
    np.testing.assert_allclose(middle + tip, [0.8, 0.0], atol=0.02)


@settings(max_examples=12, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    durations=st.lists(st.sampled_from([0.0003, 0.001, 0.002, 0.007, 0.02]), min_size=40, max_size=60),
)
def test_however_the_drives_wind_within_their_travel_it_stays_sane(seed: int, durations: list[float]) -> None:
    rng = np.random.default_rng(seed)
    twin = build_twin(COBRA, rng.choice(["default", "ideal"]))
    limits = np.array([drive.travel_limits for drive in COBRA.drives])
    speed = np.array([0.08] * 12 + [0.8, 0.1])
    travel = travel_for(twin, np.zeros((3, 2)))
    for i, duration in enumerate(durations):
        if i % 20 == 0:
            target = rng.uniform(*limits.T)
        travel = travel + np.clip(target - travel, -speed * duration, speed * duration)
        loads = twin.advance(travel, duration)
        assert np.isfinite(loads).all()
        assert np.linalg.norm(np.diff(twin.truth().vertebrae, axis=0), axis=1).max() < 0.0101
    assert twin.recoveries == 0


def test_a_state_gone_bad_is_counted_and_replaced_by_the_last_good_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log of the warning
    twin = bent(tip=(0.5, 0.5))
    good = twin.truth()
    twin.data.qvel[:] = np.nan
    travel = travel_for(twin, np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.5]]))
    assert np.isfinite(twin.advance(travel, 0.01)).all()
    assert twin.recoveries == 1
    np.testing.assert_allclose(twin.truth().tip_position, good.tip_position, atol=1e-6)
    twin.advance(travel, 0.1)
    assert twin.recoveries == 1
    assert twin.truth().time_s > good.time_s


@pytest.mark.parametrize("travel", [np.zeros(3), np.full(14, np.nan)])
def test_travel_that_is_not_one_finite_number_a_drive_is_refused(travel: np.ndarray) -> None:
    with pytest.raises(ValueError, match="14 finite numbers"):
        build_twin(COBRA).advance(travel, 0.01)


@pytest.mark.parametrize("duration", [-0.1, np.inf, np.nan])
def test_a_duration_that_is_no_time_is_refused(duration: float) -> None:
    with pytest.raises(ValueError, match="duration_s"):
        build_twin(COBRA).advance(np.zeros(14), duration)


def test_the_truth_read_from_another_thread_is_always_one_moments() -> None:
    twin = build_twin(COBRA)
    torn, reads, done = [], [0], threading.Event()

    def read() -> None:
        while not done.is_set():
            truth = twin.truth()
            reads[0] += 1
            if not np.array_equal(truth.vertebrae[-1], truth.tip_position):
                torn.append(truth)

    reader = threading.Thread(target=read)
    reader.start()
    travel = travel_for(twin, np.zeros((3, 2)))
    for i in range(200):
        travel[0] = -0.005 + 0.001 * np.sin(i)
        twin.advance(travel, 0.004)
    done.set()
    reader.join()
    assert reads[0] > 200
    assert not torn
