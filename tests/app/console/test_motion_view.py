"""Claims about what a mode adds to the 3D view."""

import msgspec
import numpy as np
import pytest
import viser

from app.console.body import Body
from app.console.motion_view import CLOUD, MotionView, moved_by
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST
from cobra.kinematics.workspace import reachable_tips
from cobra.loading import load_description
from cobra.messages import ModeReport, MotionReport, PathReport
from tests.app.console.scene_fakes import state_of

COBRA = load_description("cobra")
BORESCOPE = load_description("cobra-twist-feed")
BACKBONE = Backbone(COBRA)


def doing(mode, **report):
    motion = MotionReport(doing=ModeReport(**report))
    return msgspec.structs.replace(state_of(t=1.0), mode=mode, motion=motion)


@pytest.fixture
def view():
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    view = MotionView(server, COBRA, Body(COBRA, 0.06))
    view.start()
    yield view
    server.stop()


def test_the_remembered_path_is_a_line_while_there_is_one(view):
    points = (0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.01, 0.0, 0.2)
    path = PathReport(points=points, length_m=0.2, deviation_m=0.0, deviation_max_m=0.0)
    view.update(doing("following", path=path), reach=False)
    assert view._line.visible
    np.testing.assert_allclose(view._line.points[:2].reshape(-1, 3)[[0, 1, 3]], np.reshape(points, (3, 3)), atol=1e-7)
    np.testing.assert_allclose(view._line.points[2:], np.broadcast_to(points[6:], (57, 2, 3)), atol=1e-7)
    view.update(doing("section"), reach=False)
    assert not view._line.visible


def test_the_shape_that_it_goes_to_is_shown_before_it_goes(view):
    target = BACKBONE.configuration.rest()
    target[2] = 0.8
    view.update(doing("pose", target=tuple(target.tolist())), reach=False)
    assert view._ghost.visible
    tip = BACKBONE.tip(target)[:3, 3]
    assert np.linalg.norm(view._ghost.vertices - tip, axis=1).min() < COBRA.backbone.diameter_m
    view.update(doing("section"), reach=False)
    assert not view._ghost.visible


def test_the_reach_is_computed_when_somebody_looks_and_is_that_of_the_mode(view):
    view.update(doing("tip"), reach=False)
    assert not view._cloud.visible
    spans = {}
    for mode in ("tip", "section", "following"):
        view.update(doing(mode), reach=True)
        assert view._cloud.points.shape == (CLOUD, 3)
        spans[mode] = np.ptp(np.asarray(view._cloud.points, dtype=float), axis=0)
    assert spans["tip"][2] > 2.0 * spans["section"][2], "tip mode feeds too"
    assert np.all(spans["section"] > spans["following"])
    view.update(doing("straighten"), reach=True)
    assert not view._cloud.visible


def test_every_place_of_the_reach_is_reached_inside_the_limits():
    """Against the geometry: no tip is further from the port than what is outside, and straight ahead is in reach."""
    q = BACKBONE.configuration.rest()
    tips = reachable_tips(COBRA, q, *moved_by("tip", COBRA), 4000)
    assert np.linalg.norm(tips, axis=1).max() <= COBRA.feed.range_m[1]
    assert tips[:, 2].max() > 0.9 * COBRA.feed.range_m[1]
    only_bends = reachable_tips(COBRA, q, *moved_by("section", COBRA), 4000)
    assert np.linalg.norm(only_bends, axis=1).max() <= q[FEED] + 1e-12
    borescope = reachable_tips(
        BORESCOPE, Backbone(BORESCOPE).configuration.rest(), *moved_by("section", BORESCOPE), 100
    )
    np.testing.assert_allclose(borescope[:, :2], 0.0, atol=1e-12)
    assert moved_by("section", BORESCOPE)[1] == (TWIST, FEED)
