"""Tendons rub: tension falls along every bend, keeps its value between two bounds, and what is lost depends on the past."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.simulation.cable_kernels import relax
from cobra.simulation.losses import SPREAD, with_losses
from cobra.simulation.twin import Twin, build_twin
from tests.cobra.simulation.test_twin import travel_for

COBRA = load_description("cobra")
assert COBRA.tendon
MU_CONDUIT = COBRA.tendon.conduit_friction * COBRA.tendon.conduit_bend_rad
MU = COBRA.tendon.hole_friction


def weightless(description: RobotDescription = COBRA) -> RobotDescription:
    return replace(description, backbone=replace(description.backbone, gravity_m_s2=(0.0, 0.0, 0.0)))


def conduit(nodes: int, angle: float, length_m: float, distal_N: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Extension, stiffness and capstan of one conduit whose far end is held by a soft spring at `distal_N`."""
    share = np.full(nodes + 1, 1.0 / nodes)
    share[[0, -1]] /= 2
    stiffness = np.append(10180.0 / (length_m * share), 1.0)
    extension = np.full(nodes + 2, distal_N) / stiffness
    return extension[None], stiffness[None], np.append(np.full(nodes, np.exp(angle / nodes)), 1.0)[None]


def wind(extension: np.ndarray, stiffness: np.ndarray, capstan: np.ndarray, length_m: float) -> np.ndarray:
    """Wind in slowly; returns the tensions."""
    tension = np.zeros_like(extension)
    for _ in range(400):
        extension[0, 0] += length_m / 400
        for _ in range(5):
            relax(extension, stiffness, capstan, np.array([extension.shape[1]]), tension)
    return tension[0]


@pytest.mark.parametrize("angle", [0.05, 0.157, 0.6])
def test_along_a_conduit_tension_falls_by_the_capstan_law_in_the_direction_of_travel(angle: float) -> None:
    extension, stiffness, capstan = conduit(4, angle, 4.7, 8.0)
    pulled = wind(extension, stiffness, capstan, 0.03)
    assert pulled[-1] / pulled[0] == pytest.approx(np.exp(-angle), rel=1e-3)
    released = wind(extension, stiffness, capstan, -0.03)
    assert released[-1] / released[0] == pytest.approx(np.exp(angle), rel=1e-3)


def test_on_a_reversal_the_motor_turns_as_far_as_the_formula_says_before_the_far_end_moves() -> None:
    angle, length, distal = 0.6, 4.7, 8.0
    extension, stiffness, capstan = conduit(4, angle, length, distal)
    wind(extension, stiffness, capstan, 0.05)
    far_end = extension[0, -1]
    turned = 0.0
    while extension[0, -1] > far_end - 1e-6:
        wind(extension, stiffness, capstan, -1e-5)
        turned += 1e-5
    held = far_end * stiffness[0, -1]
    expected = held * length / 10180.0 * 2 * (np.cosh(angle) - 1) / angle
    print(f"lost motion {1e3 * turned:.3f} mm with four nodes, {1e3 * expected:.3f} mm by the formula")
    assert turned == pytest.approx(expected, rel=0.05)


@settings(max_examples=30, deadline=None)
@given(
    steps=st.lists(st.floats(-0.004, 0.004), min_size=3, max_size=20),
    angles=st.lists(st.floats(0.0, 0.5), min_size=5, max_size=5),
)
def test_however_it_is_pulled_every_node_ends_in_its_cone_and_no_cable_is_lost(
    steps: list[float], angles: list[float]
) -> None:
    stiffness = np.array([[17e3, 8e3, 8e3, 17e3, 1e5, 1e5]])
    capstan = np.exp(np.array([angles]))
    extension, tension = np.full((1, 6), 1e-4), np.zeros((1, 6))
    for step in steps:
        before = extension.sum()
        extension[0, 0] += step
        for _ in range(20):  # as a twin that goes on stepping
            relax(extension, stiffness, capstan, np.array([6]), tension)
        assert extension.sum() == pytest.approx(before + step, abs=1e-12)
        assert (tension >= 0.0).all()
        near, far = tension[0, :-1], tension[0, 1:]
        assert (near <= capstan[0] * far * 1.01 + 1e-3).all()
        assert (far <= capstan[0] * near * 1.01 + 1e-3).all()


def swept(twin: Twin, bends: list[float]) -> np.ndarray:
    """True bend of the tip section after each of these, one after the other."""
    reached = []
    for bend in bends:
        travel = travel_for(twin, np.array([[0.0, 0.0], [0.0, 0.0], [bend, 0.0]]))
        twin.advance(travel, 0.4)
        twin.advance(travel, 0.4)
        reached.append(twin.truth().bends[2, 0])
    return np.array(reached)


def test_with_friction_the_way_there_and_the_way_back_differ_and_without_they_do_not() -> None:
    loop = [0.0, 0.6, -0.6, -0.3, 0.0, 0.3, 0.6, 0.3, 0.0, -0.3, -0.6]
    lost = {}
    for losses in ("nominal", "off"):
        reached = swept(build_twin(weightless(with_losses(COBRA, losses, 0))), loop)  # type: ignore[arg-type]
        there, back = reached[2:7], reached[6:][::-1]
        lost[losses] = np.degrees(np.abs(there - back)[1:-1].mean())
    print(f"there and back differ by {lost['nominal']:.1f} degrees with friction, {lost['off']:.4f} without")
    assert lost["nominal"] > 4.0
    assert lost["off"] < 0.05


def test_at_rest_the_tensions_keep_what_friction_holds() -> None:
    twin = build_twin(weightless())
    swept(twin, [0.0, 0.6, 0.4])
    travel = travel_for(twin, np.array([[0.0, 0.0], [0.0, 0.0], [0.4, 0.0]]))
    twin.advance(travel, 0.5)
    before = twin.truth()
    twin.advance(travel, 3.0)
    after = twin.truth()
    np.testing.assert_allclose(after.tension_profile, before.tension_profile, atol=0.01)
    np.testing.assert_allclose(after.tip_position, before.tip_position, atol=5e-5)
    ratios = before.tension_profile[:, 0] / before.tension_profile[:, 1]
    assert np.ptp(ratios) > 0.05  # each is where its own past has left it, inside the bounds
    assert (np.abs(np.log(ratios)) <= MU_CONDUIT + 1e-3).all()


def test_a_tendon_that_is_wound_carries_less_at_every_station_further_on() -> None:
    twin = build_twin(weightless())
    bend = 1.2
    swept(twin, [0.0, 0.4, 0.8, bend])
    profile = twin.truth().tension_profile
    inner = COBRA.tendon_names.index("S3")  # azimuth 150 degrees: on the outside, so it is let out
    wound = COBRA.tendon_names.index("N3")
    assert profile[wound, 0] > profile[inner, 0]
    assert (np.diff(profile[wound]) <= 1e-6).all()
    assert (np.diff(profile[inner]) >= -1e-6).all()
    assert profile[wound, 1] / profile[wound, 0] == pytest.approx(np.exp(-MU_CONDUIT), rel=0.01)
    bends = np.linalg.norm(twin.truth().bends, axis=1)
    assert profile[wound, 4] / profile[wound, 1] == pytest.approx(np.exp(-MU * bends.sum()), rel=0.02)
    assert np.isnan(profile[0, 3:]).all()  # S1 ends with the first section


def test_friction_takes_work_from_the_drives_and_never_gives_any() -> None:
    twin = build_twin(weightless())
    work, last = 0.0, travel_for(twin, np.zeros((3, 2)))
    twin.advance(last, 1.0)
    for k in range(1, 801):
        b = 0.7 * np.sin(2 * np.pi * k / 400)
        travel = travel_for(twin, np.array([[b, 0.3 * b], [-b, 0.0], [0.5 * b, b]]))
        load = twin.advance(travel, 0.01)
        if k > 400:  # the second round ends where it begins
            work += float(load[:12] @ (last - travel)[:12])
        last = travel
    print(f"one round takes {1e3 * work:.1f} mJ")
    assert work > 0.005


def test_a_broken_tendon_carries_nothing_and_the_others_bend_the_robot_away_from_it() -> None:
    for losses in ("nominal", "off"):
        twin = build_twin(weightless(with_losses(COBRA, losses, 0)))  # type: ignore[arg-type]
        swept(twin, [0.0])
        twin.break_tendon("E3")
        swept(twin, [0.0])
        truth = twin.truth()
        assert truth.tensions[COBRA.tendon_names.index("E3")] == 0.0
        assert truth.bends[2] @ [np.cos(np.radians(60)), np.sin(np.radians(60))] < -0.2


def test_a_jammed_tendon_does_not_pass_on_what_its_drive_winds() -> None:
    twin = build_twin(weightless())
    swept(twin, [0.0])
    before = twin.truth()
    twin.jam("E1")
    travel = travel_for(twin, np.zeros((3, 2)))
    travel[COBRA.tendon_names.index("E1")] -= 0.004
    twin.advance(travel, 1.0)
    after = twin.truth()
    assert after.tensions[1] > before.tensions[1] + 5.0
    np.testing.assert_allclose(after.tip_position, before.tip_position, atol=2e-4)


def test_a_tendon_that_slips_on_its_spool_slackens_by_what_has_slipped() -> None:
    twin = build_twin(weightless())
    swept(twin, [0.0])
    twin.slip("S2", 0.02)
    swept(twin, [0.0])
    assert twin.truth().tensions[COBRA.tendon_names.index("S2")] == 0.0
    with pytest.raises(ValueError, match="no tendon 'S9'; there are S1"):
        twin.slip("S9", 0.02)


def test_what_hangs_on_the_tip_bends_it_down() -> None:
    level = replace(COBRA, backbone=replace(COBRA.backbone, gravity_m_s2=(0.0, 9.81, 0.0)))
    droop = []
    for payload in (0.0, 0.02):
        twin = build_twin(level, payload_kg=payload)
        swept(twin, [0.0])
        droop.append(twin.truth().tip_position[1])
    assert droop[1] > droop[0] + 0.005


def numbers(d: RobotDescription) -> dict[str, float]:
    assert d.tendon
    return {
        "EA": d.tendon.axial_stiffness_N,
        "conduit friction": d.tendon.conduit_friction,
        "hole friction": d.tendon.hole_friction,
        "backlash": d.motors[0].backlash_deg,
        **{f"EI {s.name}": s.bending_stiffness_Nm2 for s in d.sections},
        **{f"radius {s.name}": s.routing.radius_m for s in d.sections if s.routing},
    }


def test_a_seed_draws_every_loss_within_30_percent_and_always_the_same() -> None:
    described = numbers(COBRA)
    drawn = [numbers(with_losses(COBRA, "seeded", seed)) for seed in range(100)]
    for name, value in described.items():
        ratios = np.array([robot[name] / value for robot in drawn])
        assert (np.abs(ratios - 1) <= SPREAD).all(), name
        assert ratios.min() < 0.8, name
        assert ratios.max() > 1.2, name
    assert drawn[7] == numbers(with_losses(COBRA, "seeded", 7))
    assert with_losses(COBRA, "nominal", 7) == COBRA
