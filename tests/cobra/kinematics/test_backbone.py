import numpy as np
import pytest
from scipy.linalg import expm

from cobra.kinematics import kernels, section
from cobra.kinematics.backbone import Backbone, in_tip_frame
from cobra.kinematics.compiled import CompiledKinematics
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.tendons import TendonMap

SAMPLES = 40


def screws(backbone, q):
    """The tip as a product of matrix exponentials; complex numbers pass through (for complex steps)."""
    z, zero = np.zeros((4, 4), dtype=q.dtype), 0.0
    z[1, 0], z[0, 1] = q[TWIST], -q[TWIST]
    pose = expm(z)
    lengths = [
        s.length_m if i is None else q[i]
        for s, i in zip(backbone.configuration.description.sections, backbone.configuration.lengths, strict=True)
    ]
    port = backbone.active_length_m - q[FEED]
    pose = pose @ forward(-port)
    start = zero
    for length, bend in zip(lengths, backbone.configuration.bends, strict=True):
        inside = port - start if np.real(port - start) > 0 else zero
        inside = length if np.real(length - inside) < 0 else inside
        x, y = q[bend] if np.real(length - inside) > 0 else (0.0, 0.0)
        arc = np.array([[0, 0, x, 0], [0, 0, y, 0], [-x, -y, 0, length - inside], [0, 0, 0, 0]])
        pose = pose @ forward(inside) @ expm(arc)
        start = start + length
    return pose


def forward(distance):
    out = np.eye(4, dtype=np.result_type(distance, float))
    out[2, 3] = distance
    return out


def samples(backbone, seed=0, bend=1.2):
    """Random configurations: deep in the introducer, half out, wholly out; straight ones among them."""
    rng = np.random.default_rng(seed)
    layout = backbone.configuration
    for k in range(SAMPLES):
        q = layout.rest()
        q[TWIST] = rng.uniform(-3, 3)
        q[FEED] = rng.uniform(0.0, 1.4 * backbone.active_length_m)
        for where, index, part in zip(layout.bends, layout.lengths, layout.description.sections, strict=True):
            q[where] = rng.normal(size=2) * bend * (k % 4 != 0)
            if index is not None:
                q[index] = rng.uniform(*part.elongation.range_m)
        yield q


def test_the_tip_is_a_product_of_screws(robot):
    backbone = Backbone(robot)
    for q in samples(backbone):
        np.testing.assert_allclose(backbone.tip(q), screws(backbone, q), atol=2e-14)


def test_the_tip_jacobian_is_the_complex_step_of_the_screws(robot):
    backbone = Backbone(robot)
    for q in samples(backbone):
        found = backbone.tip_jacobian(q)
        tip = screws(backbone, q)
        for k in range(q.size):
            step = q.astype(complex)
            step[k] += 1e-30j
            slope = screws(backbone, step).imag / 1e-30
            spin = slope[:3, :3] @ tip[:3, :3].T
            expected = [*slope[:3, 3], spin[2, 1], spin[0, 2], spin[1, 0]]
            np.testing.assert_allclose(found[:, k], expected, atol=1e-13, err_msg=backbone.configuration.names[k])


def test_the_feeds_derivative_is_one_sided_where_a_section_enters(cobra):
    """At ℓ₀ = L_active feeding in pushes the whole shape forward; retracting takes the length from the base section."""
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[2:] = [0.8, -0.3, 0.5, 0.9, -0.2, 0.4]
    step = 1e-7
    q_in, q_out = q.copy(), q.copy()
    q_in[FEED] += step
    q_out[FEED] -= step
    feeding = (backbone.tip(q_in) - backbone.tip(q))[:3, 3] / step
    retracting = (backbone.tip(q) - backbone.tip(q_out))[:3, 3] / step
    np.testing.assert_allclose(backbone.tip_jacobian(q)[:3, FEED], feeding, atol=1e-8)
    assert np.linalg.norm(feeding - retracting) > 0.1
    q[FEED] -= 1e-6
    np.testing.assert_allclose(backbone.tip_jacobian(q)[:3, FEED], retracting, atol=1e-5)


def test_cobra_can_move_its_tip_in_all_six_directions_even_when_straight(cobra):
    backbone = Backbone(cobra)
    assert np.linalg.matrix_rank(backbone.tip_jacobian(backbone.configuration.rest()), tol=1e-6) == 6


def test_the_tip_frame_sees_feed_along_its_own_axis_when_the_tip_looks_aside(cobra):
    """Base bent by 90° to +x: pushing in moves the tip towards −x of what it looks at (+x is now its forward)."""
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[2] = np.pi / 2
    seen = in_tip_frame(backbone.tip(q), backbone.tip_jacobian(q))[:3, FEED]
    np.testing.assert_allclose(seen, [-1, 0, 0], atol=1e-12)


def test_bending_to_plus_x_goes_right_and_plus_y_goes_down(cobra):
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[6:8] = 0.3, 0.0
    assert backbone.tip(q)[0, 3] > 0.01
    q[6:8] = 0.0, 0.3
    assert backbone.tip(q)[1, 3] > 0.01


def test_points_lie_evenly_and_their_tangents_integrate_to_them(robot):
    backbone = Backbone(robot)
    for q in samples(backbone, seed=3):
        shape = backbone.points(q, 61)
        length = backbone.length(q)
        ends = backbone.section_ends(q)
        np.testing.assert_allclose(shape.positions[0], ends[0, :3, 3], atol=1e-15)
        np.testing.assert_allclose(shape.positions[-1], ends[-1, :3, 3], atol=1e-15)
        np.testing.assert_allclose(shape.rotations[-1], ends[-1, :3, :3], atol=1e-14)
        fine = np.linspace(0, length, 4001)
        tangents = backbone.poses_at(q, 0.5 * (fine[1:] + fine[:-1])).rotations[:, :, 2]
        travelled = np.cumsum(tangents, axis=0) * length / 4000
        # A bend of 2 rad within one of 4000 steps of a barely exposed section bounds what the midpoint rule can do.
        np.testing.assert_allclose(backbone.poses_at(q, fine[1:]).positions - shape.positions[0], travelled, atol=2e-4)


def test_what_is_behind_the_port_is_straight(robot):
    backbone = Backbone(robot)
    for q in samples(backbone, seed=4):
        positions = backbone.points(q, 200).positions
        port = backbone.active_length_m - q[FEED]
        behind = np.linspace(0, backbone.length(q), 200) <= port
        np.testing.assert_allclose(positions[behind, :2], 0.0, atol=1e-15)
        assert np.all(positions[behind, 2] <= 1e-12)


def test_poses_go_on_behind_the_base_and_beyond_the_tip(cobra):
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[FEED], q[2] = 0.5, 1.0
    shape = backbone.poses_at(q, np.array([-0.2, 0.0, 0.3, 0.35]))
    np.testing.assert_allclose(shape.positions[:2], [[0, 0, 0], [0, 0, 0.2]], atol=1e-15)
    tip = backbone.tip(q)
    np.testing.assert_allclose(shape.positions[3], tip[:3, 3] + 0.05 * tip[:3, 2], atol=1e-15)


def test_a_section_may_bend_as_far_as_its_exposed_length_allows(cobra):
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[FEED] = 0.23
    np.testing.assert_allclose(backbone.exposed_lengths(q), [0.03, 0.1, 0.1], atol=1e-15)
    np.testing.assert_allclose(backbone.bend_limits(q), np.radians([27.0, 90.0, 90.0]))
    q[FEED] = 0.04
    np.testing.assert_allclose(backbone.bend_limits(q), np.radians([0.0, 0.0, 36.0]), atol=1e-15)


def test_twist_turns_the_whole_robot_about_the_ports_axis(cobra):
    backbone = Backbone(cobra)
    q = backbone.configuration.rest()
    q[2:] = [0.8, -0.3, 0.5, 0.9, -0.2, 0.4]
    before = backbone.points(q).positions
    q[TWIST] = np.pi / 2
    np.testing.assert_allclose(backbone.points(q).positions, before @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-14)


def test_many_configurations_at_once_are_the_same_as_one_by_one(robot):
    backbone = Backbone(robot)
    many = np.array(list(samples(backbone, seed=5)))
    np.testing.assert_allclose(backbone.tip(many), [backbone.tip(q) for q in many], atol=1e-15)
    np.testing.assert_array_equal(backbone.bend_limits(many), [backbone.bend_limits(q) for q in many])


def test_the_compiled_kinematics_are_the_reference(robot):
    backbone, tendons, compiled = Backbone(robot), TendonMap(robot), CompiledKinematics(robot, count=37)
    compiled.warm_up()
    for q in [*samples(backbone, seed=6), *samples(backbone, seed=7, bend=1e-3), *samples(backbone, seed=8, bend=0.2)]:
        tick = compiled(q)
        shape = backbone.points(q, 37)
        np.testing.assert_allclose(tick.positions, shape.positions, atol=1e-14)
        np.testing.assert_allclose(tick.rotations, shape.rotations, atol=1e-14)
        np.testing.assert_allclose(tick.tip, backbone.tip(q), atol=1e-14)
        np.testing.assert_allclose(tick.jacobian, backbone.tip_jacobian(q), atol=1e-14)
        np.testing.assert_allclose(tick.tendons, tendons.lengths(q), atol=1e-16)


@pytest.mark.parametrize("theta", [0.0, 1e-8, 1e-3, 0.1, 0.3, 0.316, 0.317, 1.0, 3.0, 7.0])
def test_the_compiled_coefficients_are_the_reference(theta):
    np.testing.assert_allclose(kernels.coefficients(theta**2), section.coefficients(theta**2), rtol=3e-15)


def test_compiling_never_happens_while_driving(cobra):
    """A read-only or strided q must not make numba compile anew, for seconds, in the middle of a motion."""
    tick = CompiledKinematics(cobra)
    tick.warm_up()
    before = len(kernels.tick.signatures)
    frozen = tick.rest.copy()
    frozen.flags.writeable = False
    for q in (frozen, np.zeros((8, 2))[:, 0], tuple(frozen), frozen.astype(np.float32)):
        tick(q)
    assert len(kernels.tick.signatures) == before


def test_a_read_only_installation_compiles_without_a_cache(monkeypatch):
    real = kernels.numba.njit

    def njit(**options):
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return real(**options)

    monkeypatch.setattr(kernels.numba, "njit", njit)
    assert kernels.compiled(lambda x: x + 1)(1) == 2
