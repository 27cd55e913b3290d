import msgspec
import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss

from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED
from cobra.kinematics.tendons import TendonMap


def random_q(description, seed, scale=1.0):
    rng = np.random.default_rng(seed)
    layout = Backbone(description).configuration
    q = layout.rest()
    for bend, index, section in zip(layout.bends, layout.lengths, description.sections, strict=True):
        q[bend] = rng.uniform(-1, 1, 2) * scale
        if index is not None:
            q[index] = rng.uniform(*section.elongation.range_m)
    return q


def integrated_lengths(description, q):
    """Length of each tendon's path through its holes, by integrating |dr/ds| along the robot."""
    backbone = Backbone(description)
    lengths = backbone.configuration.section_lengths(q)
    starts = np.cumsum(lengths) - lengths
    nodes, weights = leggauss(24)
    step = 1e-6
    out = []
    for last, section in enumerate(description.sections):
        for azimuth in np.radians(section.routing.azimuths_deg) if section.routing else ():
            hole = section.routing.radius_m * np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
            total = 0.0
            for k in range(last + 1):
                s = starts[k] + lengths[k] * (nodes + 1) / 2
                paths = [backbone.poses_at(q, s + d) for d in (-step, step)]
                behind, ahead = (shape.positions + shape.rotations @ hole for shape in paths)
                speed = np.linalg.norm(ahead - behind, axis=1) / (2 * step)
                total += speed @ weights * lengths[k] / 2
            out.append(total)
    return np.array(out)


@pytest.mark.parametrize("seed", range(3))
def test_tendon_lengths_are_those_of_the_paths_through_the_holes(robot, seed):
    tendons = TendonMap(robot)
    q = random_q(robot, seed)
    q[FEED] = robot.active_length_m
    straight = tendons.rest.copy()
    straight[FEED] = robot.active_length_m
    expected = integrated_lengths(robot, q) - integrated_lengths(robot, straight)
    np.testing.assert_allclose(tendons.lengths(q), expected, atol=2e-10)


def test_the_inner_tendon_is_pulled_in_and_its_antagonist_let_out_by_as_much(cobra):
    tendons = TendonMap(cobra)
    q = tendons.rest.copy()
    q[2] = 0.5  # the base section bends to +x, towards its tendon E1
    by_name = dict(zip(cobra.tendon_names, tendons.lengths(q), strict=True))
    radius = cobra.sections[0].routing.radius_m
    assert by_name["E1"] == pytest.approx(-radius * 0.5)
    assert by_name["W1"] == pytest.approx(radius * 0.5)
    assert by_name["N1"] == pytest.approx(0.0, abs=1e-15)


def test_distal_tendons_are_moved_by_proximal_bends_and_not_the_other_way(cobra):
    tendons = TendonMap(cobra)
    q = tendons.rest.copy()
    q[6:8] = 0.4, 0.2
    lengths = tendons.lengths(q)
    np.testing.assert_array_equal(lengths[:8], 0.0)
    assert np.linalg.norm(lengths[8:]) > 1e-3
    q[2:4] = 0.4, 0.2
    assert np.all(np.abs(tendons.lengths(q) - lengths)[8:] > 1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_the_shape_comes_back_from_the_lengths(robot, seed):
    tendons = TendonMap(robot)
    q = random_q(robot, seed, scale=2.0)
    known = q.copy()
    known[tendons.columns] = 7.0  # what the tendons decide is not taken from there
    shape = tendons.shape(tendons.lengths(q), known)
    np.testing.assert_allclose(shape.q, q, atol=1e-11)
    assert shape.residual_norm_m < 1e-12


def test_a_slipped_tendon_shows_in_the_residual_and_a_bend_does_not(cobra):
    tendons = TendonMap(cobra)
    q = random_q(cobra, 3)
    lengths = tendons.lengths(q)
    lengths[5] += 0.002
    shape = tendons.shape(lengths, q)
    # Two bends fit half of it; the other half stays on the pair E2-W2, where one tendon cannot be told from the other.
    np.testing.assert_allclose(shape.residual_m[[5, 7]], 0.001, atol=1e-4)
    assert np.all(np.abs(np.delete(shape.residual_m, [5, 7])) < 1e-4)


def test_rates_go_through_the_same_matrix(robot):
    tendons = TendonMap(robot)
    rng = np.random.default_rng(0)
    q, rate = random_q(robot, 1), rng.normal(size=tendons.rest.size)
    slope = (tendons.lengths(q + 1e-3 * rate) - tendons.lengths(q - 1e-3 * rate)) / 2e-3
    np.testing.assert_allclose(tendons.rates(rate), slope, atol=1e-12)


def test_cobras_matrix_is_well_conditioned_with_six_consistency_modes(cobra):
    """12 tendons, 6 bends: rank 6, condition 4.05 (an independent computation), 6 ways to pretension."""
    own = TendonMap(cobra).matrix[:, 2:] / 0.0033
    values = np.linalg.svd(own, compute_uv=False)
    assert own.shape == (12, 6)
    assert values[0] / values[-1] == pytest.approx(4.05, abs=0.01)


def test_tendons_that_cannot_decide_the_shape_are_refused(robots):
    bad = robots["elongating"]
    routing = msgspec.structs.replace(bad.sections[0].routing, azimuths_deg=(0.0, 0.0, 180.0))
    sections = (msgspec.structs.replace(bad.sections[0], routing=routing), *bad.sections[1:])
    with pytest.raises(ValueError, match="add tendons or spread their azimuths"):
        TendonMap(msgspec.structs.replace(bad, sections=sections))
