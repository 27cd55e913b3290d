"""The twin's chain is the elastic beam that the description says: cantilevers, and SRC-Bot's chambers (S-38)."""

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.description import Elongation, RobotDescription, Routing, Section
from cobra.loading import load_description
from cobra.simulation.losses import with_losses
from cobra.simulation.twin import Twin, build_twin
from tests.cobra.simulation.references import cantilever

COBRA = with_losses(load_description("cobra"), "off", 0)
EI, LENGTH = COBRA.sections[0].bending_stiffness_Nm2, COBRA.active_length_m
SLACK = np.array([0.2] * 12 + [0.0, LENGTH])


def beam(gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Twin:
    """COBRA with its tendons hanging loose."""
    twin = build_twin(replace(COBRA, backbone=replace(COBRA.backbone, gravity_m_s2=gravity)))
    twin.advance(SLACK, 0.0)
    return twin


@pytest.mark.parametrize("force", [0.001, 0.03], ids=["small", "large"])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (0.6, 0.8)], ids=["x", "-y", "between"])
def test_a_force_on_the_tip_bends_it_like_a_cantilever(force: float, direction: tuple[float, float]) -> None:
    twin = beam()
    twin.push(-1, np.array([*direction, 0.0]) * force)
    twin.advance(SLACK, 6.0)
    tip = twin.truth().tip_position
    sideways, ahead = cantilever(EI, LENGTH, tip_N=force)
    assert tip[:2] @ direction == pytest.approx(sideways, rel=0.005)
    assert tip[2] == pytest.approx(ahead, abs=0.005 * LENGTH)
    assert abs(tip[0] * direction[1] - tip[1] * direction[0]) < 0.005 * sideways


@pytest.mark.parametrize("gravity", [0.5, 3.0])
def test_its_own_weight_bends_it_like_a_heavy_cantilever(gravity: float) -> None:
    twin = beam((0.0, gravity, 0.0))
    twin.advance(SLACK, 8.0)
    sideways, ahead = cantilever(EI, LENGTH, weight_N_m=COBRA.backbone.mass_per_length_kg_m * gravity)
    np.testing.assert_allclose(twin.truth().tip_position, [0.0, sideways, ahead], atol=0.005 * LENGTH)


def test_a_torque_about_the_tip_twists_it_by_its_torsional_stiffness() -> None:
    twin = beam()
    twin.push(-1, np.zeros(3), np.array([0.0, 0.0, 0.02]))
    twin.advance(SLACK, 3.0)
    w, _, _, z = twin.truth().tip_wxyz
    expected = 0.02 * LENGTH / COBRA.sections[0].torsional_stiffness_Nm2
    assert 2 * np.arctan2(z, w) == pytest.approx(expected, rel=0.005)


CHAMBERS, L0, RADIUS = 5, 0.05, 0.03
LENGTH_OF_ARM = CHAMBERS * L0
SRC_EI, SRC_GJ, SRC_K = 0.1006, 0.2106, 5136.0
AROUND = np.radians([0.0, 120.0, 240.0])
TOWARDS = np.stack([np.cos(AROUND), np.sin(AROUND)], axis=1)


def src_bot() -> RobotDescription:
    section = Section(
        name="arm",
        length_m=CHAMBERS * L0,
        max_bend_deg=90.0,
        vertebrae=CHAMBERS,
        vertebra_thickness_m=0.004,
        bending_stiffness_Nm2=SRC_EI,
        torsional_stiffness_Nm2=SRC_GJ,
        routing=Routing(names=("C1", "C2", "C3"), azimuths_deg=(0.0, 120.0, 240.0), radius_m=RADIUS),
        elongation=Elongation(
            range_m=(0.2, 0.26),
            stiffness_N_m=SRC_K,
            rate_m_s=0.02,
            acceleration_m_s2=0.1,
            locked_length_m=0.04,
            unlocked_length_m=0.042,
        ),
    )
    drives = tuple(replace(COBRA.drives[i], name=f"C{i + 1}", tendon=f"C{i + 1}") for i in range(3))
    backbone = replace(COBRA.backbone, total_length_m=0.25, diameter_m=0.07, mass_per_length_kg_m=1.6)
    tendon = replace(COBRA.tendon, axial_stiffness_N=7500.0, conduit_length_m=0.0, max_tension_N=200.0)
    return replace(COBRA, sections=(section,), drives=drives, backbone=backbone, tendon=tendon, twist=None, feed=None)


def arc_length(twin: Twin) -> float:
    """Of the backbone, from the chords between the guiders [m]."""
    chords = np.linalg.norm(np.diff(np.vstack([np.zeros(3), twin.truth().vertebrae]), axis=0), axis=1)
    half = np.linalg.norm(twin.truth().bends[0]) / CHAMBERS / 2
    return float((chords / np.sinc(half / np.pi)).sum())


@pytest.mark.parametrize("bend", [(0.0, 0.0), (0.4, 0.0), (-0.2, 0.35), (0.7, -0.7)])
def test_src_bots_cables_set_bend_and_length(bend: tuple[float, float]) -> None:
    twin = build_twin(src_bot(), "ideal")
    shorter = 0.025
    cables = -shorter - RADIUS * TOWARDS @ bend  # S-8, with the signs of MODEL.md
    twin.advance(cables, 0.5)
    twin.advance(cables, 3.0)
    np.testing.assert_allclose(twin.truth().bends[0], bend, atol=0.01)
    assert LENGTH_OF_ARM - arc_length(twin) == pytest.approx(shorter, abs=0.0006)


@pytest.mark.parametrize("bend", [(0.0, 0.0), (0.3, 0.0), (-0.15, 0.25), (0.3, -0.3)])
def test_src_bots_chambers_give_way_to_its_cables_as_s38_says(bend: tuple[float, float]) -> None:
    twin = build_twin(src_bot(), "ideal")
    cables = -0.015 - RADIUS * TOWARDS @ bend
    twin.advance(cables, 0.5)
    tension = twin.advance(cables, 3.0)
    turned = RADIUS * TOWARDS.T @ tension * L0 / SRC_EI * CHAMBERS
    shorter = tension.sum() / SRC_K * CHAMBERS
    # Straight cables between the guiders press the bent chambers further: T L/12 against EI/L.
    softer = 1 - tension.sum() * L0**2 / 12 / SRC_EI
    np.testing.assert_allclose(twin.truth().bends[0] * softer, turned, atol=0.01 * (0.05 + np.hypot(*bend)))
    assert LENGTH_OF_ARM - arc_length(twin) == pytest.approx(shorter, rel=0.01)


def test_src_bots_chambers_twist_by_their_torsional_stiffness() -> None:
    twin = build_twin(src_bot(), "ideal")
    slack = np.full(3, 0.05)
    twin.advance(slack, 0.0)
    twin.push(-1, np.zeros(3), np.array([0.0, 0.0, 0.2]))
    twin.advance(slack, 3.0)
    w, _, _, z = twin.truth().tip_wxyz
    assert 2 * np.arctan2(z, w) == pytest.approx(0.2 * L0 / SRC_GJ * CHAMBERS, rel=0.005)


def test_src_bot_hangs_longer_under_its_own_weight() -> None:
    twin = build_twin(src_bot(), "default")
    slack = np.full(3, 0.05)
    twin.advance(slack, 0.0)
    twin.advance(slack, 3.0)
    # Each chamber carries the guiders from it on: 5 + 4 + 3 + 2 + 1, but for the half pitch beyond the last.
    expected = 0.08 * 9.81 / SRC_K * 15
    assert arc_length(twin) - LENGTH_OF_ARM == pytest.approx(expected, rel=0.25)
