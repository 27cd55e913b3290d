"""What is drawn is the robot: the tube lies around the backbone, tendons where they are routed, nothing twists."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from app.console.body import Body
from app.console.detail import FULL
from app.console.meshes import lathe, quaternions, sweep, sweep_faces, unit_circle
from cobra.kinematics.tendons import TendonMap
from tests.app.console.scene_fakes import COBRA, bend_of, elongating, rotation_between, without_tendons

HIDDEN_M = 0.06
SLEEVE_RINGS = 4


@pytest.fixture(params=[COBRA, elongating(), without_tendons()], ids=["cobra", "elongating", "without-tendons"])
def body(request):
    return Body(request.param, HIDDEN_M)


def rings_of(body, vertices):
    """(rings, sides, 3) of the active segment, without the sleeve behind it and the cap at the tip."""
    return vertices.reshape(-1, FULL.sides, 3)[SLEEVE_RINGS : -FULL.cap_rings]


def signed_volume(vertices, faces):
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0


@pytest.mark.parametrize("t", [0.0, 1.0, 2.5, 4.0])
def test_the_tube_stays_at_its_radius_from_the_backbone(body, t):
    q = np.array(bend_of(body.description, t))
    backbone = cKDTree(body.backbone.points(q, 6001).positions)
    distance, _ = backbone.query(rings_of(body, body.pose(q).tube).reshape(-1, 3))
    np.testing.assert_allclose(distance, body.tube_radius_m, rtol=2e-5)


@pytest.mark.parametrize("t", [0.0, 1.0, 2.5, 4.0])
def test_rings_stand_square_on_the_backbone(body, t):
    q = np.array(bend_of(body.description, t))
    rings = rings_of(body, body.pose(q).tube)
    centres = rings.mean(axis=1)
    dense = body.backbone.points(q, 6001)
    _, nearest = cKDTree(dense.positions).query(centres)
    along = np.einsum("rsi,ri->rs", rings - centres[:, None], dense.rotations[nearest, :, 2])
    assert np.abs(along).max() < 1e-5


def test_the_tube_does_not_twist_along_the_backbone(body):
    """Between neighbouring rings a line of vertices turns only as far as the tangent does."""
    q = np.array(bend_of(body.description, 1.7))
    rings = rings_of(body, body.pose(q).tube)
    offsets = rings - rings.mean(axis=1)[:, None]
    normals = np.cross(offsets[:, 0], offsets[:, FULL.sides // 4])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    for here, after, a, b in zip(offsets[:-1], offsets[1:], normals[:-1], normals[1:], strict=True):
        np.testing.assert_allclose(here @ rotation_between(a, b).T, after, atol=1e-9)


def test_the_tube_ends_round_at_the_tip(body):
    q = np.array(bend_of(body.description, 1.7))
    pose = body.pose(q)
    np.testing.assert_allclose(pose.tip_position, body.backbone.tip(q)[:3, 3], atol=1e-12)
    cap = pose.tube.reshape(-1, FULL.sides, 3)[-FULL.cap_rings :]
    radii = np.linalg.norm(cap - cap.mean(axis=1)[:, None], axis=2).mean(axis=1)
    assert radii[0] == pytest.approx(body.tube_radius_m)
    assert (np.diff(radii) < 0.0).all()
    np.testing.assert_allclose(cap[-1], np.tile(pose.tip_position, (FULL.sides, 1)), atol=1e-9)


@pytest.mark.parametrize("feed", [0.0, 0.03, 0.15, 0.3, 0.45, 1.0])
def test_the_body_reaches_from_the_introducers_back_to_the_tip_at_any_feed(feed):
    body = Body(COBRA, HIDDEN_M)
    q = np.zeros(8)
    q[1] = feed
    pose = body.pose(q)
    for points in (pose.tube, pose.tendons.reshape(-1, 3), pose.vertebrae):
        assert points[:, 2].min() > -HIDDEN_M - 1e-9
        assert points[:, 2].max() < feed + 1e-9
    assert pose.tube[:, 2].min() == pytest.approx(-HIDDEN_M)
    assert pose.tube[:, 2].max() == pytest.approx(feed)


@pytest.mark.parametrize("t", [0.0, 1.0, 2.5])
def test_drawn_tendons_are_as_long_as_the_kinematics_says(t):
    body, q = Body(COBRA, HIDDEN_M), np.array(bend_of(COBRA, t))
    pose, straight = body.pose(q), body.pose(body.backbone.configuration.rest())

    def lengths(segments):
        each = np.linalg.norm(segments[:, 1] - segments[:, 0], axis=1)
        return np.bincount(body.segment_tendon, weights=each)

    drawn = lengths(pose.tendons) - lengths(straight.tendons)
    # Chords are shorter than the arcs they stand for, by less than 0.1 % here.
    np.testing.assert_allclose(drawn, TendonMap(COBRA).lengths(q), atol=1.5e-4)


def test_tendons_run_at_their_radius_and_azimuth_and_end_with_their_section():
    body = Body(COBRA, HIDDEN_M)
    segments = body.pose(np.array([0.0, 0.3, *[0.0] * 6])).tendons
    tendon = 0
    for i, section in enumerate(COBRA.sections):
        for azimuth in np.radians(section.routing.azimuths_deg):
            own = segments[body.segment_tendon == tendon]
            expected = section.routing.radius_m * np.array([np.cos(azimuth), np.sin(azimuth)])
            np.testing.assert_allclose(own[:, :, :2], np.broadcast_to(expected, (len(own), 2, 2)), atol=1e-12)
            assert own[-1, 1, 2] == pytest.approx(0.1 * (i + 1))
            assert len(own) == FULL.rings * (i + 1)
            tendon += 1
    assert tendon == len(COBRA.tendon_names)


def test_vertebrae_stand_at_their_pitch_and_the_head_ends_at_the_tip():
    body = Body(COBRA, HIDDEN_M)
    pose = body.pose(np.array([0.0, 0.3, *[0.0] * 6]))
    own, collars = pose.vertebrae[:30], pose.vertebrae[30:]
    np.testing.assert_allclose(own[:, 2], 0.005 + 0.01 * np.arange(30), atol=1e-12)
    np.testing.assert_allclose(collars[:-1, 2], [0.1, 0.2], atol=1e-12)
    assert collars[-1, 2] + 0.5 * body.vertebra_sizes[-1, 2] == pytest.approx(0.3)
    assert len(pose.vertebrae_wxyz) == len(body.vertebra_sizes) == 33


def test_twist_turns_the_tendons_with_the_body():
    body = Body(COBRA, HIDDEN_M)
    q = np.array([0.0, 0.3, 0.4, 0.2, -0.5, 0.3, 0.6, 0.1])
    turned = q.copy()
    turned[0] = 0.7
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7]).as_matrix()
    np.testing.assert_allclose(body.pose(turned).tendons, body.pose(q).tendons @ turn.T, atol=1e-12)


def test_rings_follow_any_frames():
    rng = np.random.default_rng(3)
    points, frames = rng.normal(size=(20, 3)), Rotation.random(20, random_state=3).as_matrix()
    radii = rng.uniform(0.5, 2.0, 20)
    rings = sweep(points, frames, radii, unit_circle(12)).reshape(20, 12, 3) - points[:, None]
    np.testing.assert_allclose(np.linalg.norm(rings, axis=2), np.tile(radii[:, None], (1, 12)))
    np.testing.assert_allclose(np.einsum("rsi,ri->rs", rings, frames[:, :, 2]), 0.0, atol=1e-12)
    np.testing.assert_allclose(rings[:, 0], radii[:, None] * frames[:, :, 0])


@pytest.mark.parametrize(
    "profile", [((0.0, 0.0), (0.0, 1.0), (2.0, 1.0), (2.0, 0.0)), ((0.0, 0.0), (1.0, 1.0), (2.0, 0.0))]
)
def test_solids_have_their_outside_outside(profile):
    z, r = np.array(profile).T
    exact = np.pi / 3.0 * np.sum(np.diff(z) * (r[:-1] ** 2 + r[:-1] * r[1:] + r[1:] ** 2))
    vertices, faces = lathe(profile, 400)
    assert signed_volume(vertices, faces) == pytest.approx(exact, rel=1e-3)


def test_a_sharp_corner_shares_no_vertices_and_a_rounding_does():
    sharp, _ = lathe(((0.0, 1.0), (1.0, 1.0), (1.0, 2.0)), 8)
    smooth, _ = lathe(((0.0, 1.0), (1.0, 1.0), (2.0, 1.2)), 8)
    assert len(sharp) == 4 * 8
    assert len(smooth) == 3 * 8


def test_faces_use_every_vertex_and_only_neighbouring_rings():
    faces = sweep_faces(5, 7)
    assert set(faces.ravel().tolist()) == set(range(35))
    rings = faces // 7
    assert (rings.max(axis=1) - rings.min(axis=1) == 1).all()


def test_quaternions_agree_with_scipy():
    turns = Rotation.concatenate([Rotation.random(500, random_state=5), Rotation.from_euler("xyz", np.eye(3) * np.pi)])
    ours, theirs = quaternions(turns.as_matrix()), turns.as_quat()[:, [3, 0, 1, 2]]
    np.testing.assert_allclose(np.abs(np.einsum("ij,ij->i", ours, theirs)), 1.0)
