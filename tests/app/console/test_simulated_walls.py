"""The 3D view shows a simulated robot's walls, what presses and how far they are, and says whose knowledge that is."""

from collections.abc import Iterator

import msgspec
import numpy as np
import pytest
import viser

from app.console.simulated_walls import PLACES, SimulatedWalls
from app.robot_process import _walls
from cobra.loading import load_description
from cobra.messages import Touch, decode
from cobra.simulation.environments import environment
from cobra.simulation.losses import with_losses
from cobra.simulation.twin import build_twin
from tests.cobra.simulation.test_twin import travel_for

COBRA = with_losses(load_description("cobra"), "off", 0)


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def walls(server: viser.ViserServer) -> Iterator[SimulatedWalls]:
    surroundings = environment("engine-stage", COBRA)
    assert surroundings
    view = SimulatedWalls(server, COBRA, _walls(surroundings))
    view.start()
    yield view
    server.scene.reset()


def label(view: SimulatedWalls) -> str:
    return view._label.text if view._label.visible else ""


def test_walls_can_be_seen_through_and_blades_are_solid(server: viser.ViserServer, walls: SimulatedWalls) -> None:
    surroundings = environment("engine-stage", COBRA)
    assert surroundings
    drawn = {name: server.scene._handle_from_node_name[name] for name in ("/walls/solid", "/walls/clear back")}
    faces = sum(len(handle.faces) for handle in drawn.values())
    assert faces == len(surroundings.faces)
    assert drawn["/walls/solid"].opacity is None
    assert drawn["/walls/clear back"].opacity < 0.5


def test_nothing_is_said_far_from_the_walls(walls: SimulatedWalls) -> None:
    walls.update(None)
    walls.update(Touch(clearance_m=0.05, clearance_points=((0.0, 0.0, 0.1), (0.05, 0.0, 0.1))))
    assert label(walls) == ""
    assert not walls._marks.visible


def test_near_a_wall_the_clearance_is_told_as_the_simulations(walls: SimulatedWalls) -> None:
    walls.update(Touch(clearance_m=0.0034, clearance_points=((0.0, 0.0, 0.1), (0.008, 0.0, 0.1))))
    assert label(walls) == "simulated: 3.4 mm to the wall"
    np.testing.assert_allclose(walls._label.position, [0.008, 0.0, 0.1])


def test_each_contact_is_marked_with_a_line_along_its_force(walls: SimulatedWalls) -> None:
    touch = Touch(
        contact_points=((0.01, 0.0, 0.2), (0.0, 0.01, 0.3)),
        contact_forces=((-0.5, 0.0, 0.0), (0.0, -1.0, 0.0)),
        clearance_m=0.0,
        clearance_points=((0.0, 0.0, 0.2), (0.01, 0.0, 0.2)),
    )
    walls.update(touch)
    assert label(walls) == "simulated: the walls press with 1.1 N"
    starts, ends = np.moveaxis(np.asarray(walls._forces.points), 1, 0)
    assert len(ends) == PLACES
    # The strongest first; a newton is five radii of the body long, and comes from within the wall.
    np.testing.assert_allclose(ends[0], [0.0, 0.01, 0.3], atol=1e-6)
    np.testing.assert_allclose(starts[0], [0.0, 0.01 + 5 * 0.0045, 0.3], atol=1e-6)
    np.testing.assert_allclose(starts[1], [0.01 + 2.5 * 0.0045, 0.0, 0.2], atol=1e-6)
    walls.update(Touch())
    assert not walls._marks.visible
    assert label(walls) == ""


def test_the_bodys_true_axis_is_drawn_from_the_port_on(walls: SimulatedWalls) -> None:
    walls.update(Touch(passive=((0.0, 0.0, -0.1),), vertebrae=((0.0, 0.0, 0.1), (0.01, 0.0, 0.2))))
    assert walls._shape is not None
    np.testing.assert_allclose(walls._shape.points[0], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]], atol=1e-7)
    np.testing.assert_allclose(walls._shape.points[1], [[0.0, 0.0, 0.1], [0.01, 0.0, 0.2]], atol=1e-7)


def test_the_twins_truth_is_understood_as_it_goes_over_the_link() -> None:
    twin = build_twin(COBRA, environment=environment("straight-pipe", COBRA))
    bent = travel_for(twin, np.array([[0.7, 0.0]] * 3))
    twin.advance(travel_for(twin, np.zeros((3, 2))), 0.0)
    twin.advance(bent, 1.0)
    truth = twin.truth()
    touch = decode(msgspec.msgpack.encode(truth, enc_hook=lambda array: array.tolist()), Touch)
    assert len(touch.contact_points) > 0
    np.testing.assert_array_equal(touch.contact_forces, truth.contact_forces)
    assert touch.clearance_m == truth.clearance_m
