"""Claims about the twin in the 3D view: where it is drawn, how a drag becomes a push, and the predicted shape beside it."""

import msgspec
import numpy as np
import pytest
import viser

from app.console.prediction import Prediction
from app.console.twin_view import REPEAT_S, TwinView
from cobra.errors import OperatorError
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import Configuration
from cobra.loading import load_description
from cobra.mechanics.chain import backbone_frames
from cobra.mechanics.described import parameters_of
from cobra.mechanics.inverse import equilibrium, inverse_statics
from cobra.messages import Push

SRC_BOT = load_description("src-bot")
PLACES = [(0.0, 0.0, 0.045 * (i + 1)) for i in range(5)]
TRUTH = msgspec.msgpack.encode({"vertebrae": PLACES, "tip_wxyz": [1.0, 0.0, 0.0, 0.0]})


@pytest.fixture
def view():
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    view = TwinView(server, SRC_BOT, 0.0375)
    view.update(TRUTH, 0.0)
    yield view
    server.stop()


def test_a_drag_pushes_towards_the_mouse_the_harder_the_further_and_never_more_than_the_limit(view):
    sizes = []
    for distance in (0.01, 0.03, 0.5):
        view.drag(1, 3, (distance, 0.0, PLACES[3][2]), over=False)
        force = view.pushes[3]
        assert force[1:] == pytest.approx([0.0, 0.0])
        sizes.append(force[0])
    assert sizes == pytest.approx([1.6, 4.8, 10.0])


def test_a_held_drag_is_repeated_and_letting_go_sends_the_end_once(view):
    view.drag(1, 2, (0.02, 0.0, PLACES[2][2]), over=False)
    first = view.update(TRUTH, 1.0)
    assert [push.vertebra for push in first] == [2]
    assert view.update(TRUTH, 1.0 + REPEAT_S / 2) == []
    assert view.update(TRUTH, 1.0 + 1.1 * REPEAT_S) == first
    view.drag(1, 2, (0.0, 0.0, 0.0), over=True)
    assert view.update(TRUTH, 1.01 + 1.1 * REPEAT_S) == [Push(vertebra=2)]
    assert view.update(TRUTH, 9.0) == []


def test_who_leaves_lets_go_and_two_hands_add_up(view):
    view.drag(1, 2, (0.01, 0.0, PLACES[2][2]), over=False)
    view.drag(2, 2, (0.0, 0.01, PLACES[2][2]), over=False)
    assert view.pushes[2] == pytest.approx([1.6, 1.6, 0.0])
    view.forget(1)
    assert view.pushes[2] == pytest.approx([0.0, 1.6, 0.0])


@pytest.mark.parametrize(("vertebra", "to"), [(None, (0.1, 0, 0)), (7, (0.1, 0, 0)), (1, (float("nan"), 0, 0))])
def test_a_drag_of_nothing_or_to_nowhere_pushes_nothing(view, vertebra, to):
    view.drag(1, vertebra, to, over=False)
    assert view.pushes == {}


def test_weightless_and_unloaded_the_prediction_is_the_arc_of_constant_curvature():
    level = msgspec.structs.replace(
        SRC_BOT, backbone=msgspec.structs.replace(SRC_BOT.backbone, gravity_m_s2=(0.0, 0.0, 0.0))
    )
    q = Configuration(level).home()
    q[2:4] = 0.4, -0.2
    points = Prediction(level).frames(q, {})[:, :3, 3]
    arc = Backbone(level).points(q, len(points)).positions
    assert points == pytest.approx(arc, abs=2e-4)


def test_gravity_across_and_a_known_load_bend_the_prediction_to_where_the_statics_have_their_balance():
    across = msgspec.structs.replace(
        SRC_BOT, backbone=msgspec.structs.replace(SRC_BOT.backbone, gravity_m_s2=(0.0, 9.81, 0.0))
    )
    q = Configuration(across).home()
    prediction, parameters = Prediction(across), parameters_of(across)
    arc = Backbone(across).points(q, prediction.count).positions
    load = {2: np.array([5.0, 0.0, 0.0])}
    sagged, pushed = (prediction.frames(q, loads)[:, :3, 3] for loads in ({}, load))
    assert np.linalg.norm(sagged - arc, axis=1).max() > 0.002
    assert (pushed - sagged)[:, 0].max() > 0.001
    # The other way round: the tensions found, put in as forces, hold the same shape.
    loads = np.zeros((5, 3))
    loads[2, 0] = 5.0
    posture = inverse_statics(parameters, (0.0, 0.0), float(q[4]), loads)
    again = backbone_frames(equilibrium(parameters, posture.tensions_N, loads, posture.q), 6)[:, :3, 3]
    assert pushed == pytest.approx(again, abs=1e-6)


def test_a_robot_without_equations_of_motion_has_no_prediction():
    with pytest.raises(OperatorError, match="no equations of motion"):
        Prediction(load_description("cobra"))
