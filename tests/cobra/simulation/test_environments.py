"""Walls are solid, are felt in the tendons, and a mesh that cannot be one is refused in words."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from msgspec.structs import replace

from cobra.clock import ManualClock
from cobra.description import RobotDescription
from cobra.loading import load_description, robot_names
from cobra.motors.open_bus import open_bus
from cobra.simulation.drives import world_of
from cobra.simulation.environments import Environment, WallsError, environment
from cobra.simulation.environments.mesh_file import winding
from cobra.simulation.losses import with_losses
from cobra.simulation.options import ENVIRONMENTS, Simulation, SimulationError
from cobra.simulation.twin import Twin, build_twin
from tests.cobra.simulation.test_twin import travel_for

COBRA = with_losses(load_description("cobra"), "off", 0)
WEIGHTLESS = replace(COBRA, backbone=replace(COBRA.backbone, gravity_m_s2=(0.0, 0.0, 0.0)))
RADIUS = COBRA.backbone.diameter_m / 2
BORE = 2.6 * COBRA.backbone.diameter_m
FEED = COBRA.feed_drive


def inside(world: str, description: RobotDescription = WEIGHTLESS) -> Twin:
    return build_twin(description, environment=environment(world, description))


def bend(twin: Twin, angle: float, feed_m: float = 0.3, seconds: float = 1.5) -> np.ndarray:
    """Wind for the same bend towards +x in all sections; returns the loads at the end."""
    travel = travel_for(twin, np.array([[angle, 0.0]] * 3), feed_m=feed_m)
    twin.advance(travel, seconds)
    return twin.advance(travel, 1.0)


@pytest.mark.parametrize("robot", [name for name in robot_names() if name != "cobra-twist-feed"])
@pytest.mark.parametrize("world", ENVIRONMENTS[1:])
def test_every_robot_starts_free_in_every_world_that_is_made_for_it(robot: str, world: str) -> None:
    description = load_description(robot)
    walls = environment(world, description)
    assert walls
    reach = description.feed.start_m if description.feed else description.active_length_m
    z = np.linspace(0.0, reach, 200)
    distance, _ = walls.distance(np.stack([0 * z, 0 * z, z], axis=1))
    assert distance.min() > 1.05 * description.backbone.diameter_m / 2


def test_the_distance_to_a_pipe_is_what_is_left_of_its_bore() -> None:
    walls = environment("straight-pipe", COBRA)
    assert walls
    rng = np.random.default_rng(1)
    radial, around = rng.uniform(0.0, 0.011, 200), rng.uniform(0.0, 2 * np.pi, 200)
    points = np.stack([radial * np.cos(around), radial * np.sin(around), rng.uniform(0.1, 0.9, 200)], axis=1)
    distance, places = walls.distance(points)
    # A polygon of 24 sides is up to 0.9 % of its radius nearer than the circle.
    np.testing.assert_allclose(distance, BORE / 2 - radial, atol=0.009 * BORE / 2)
    np.testing.assert_allclose(np.linalg.norm(places - points, axis=1), distance, atol=1e-12)


def test_a_pipe_holds_the_robot_in_whatever_its_tendons_pull() -> None:
    twin = inside("straight-pipe")
    bend(twin, 0.0)
    assert twin.truth().clearance_m == pytest.approx(BORE / 2 - RADIUS, abs=2e-4)
    bend(twin, 0.8)
    truth = twin.truth()
    off_axis = np.hypot(truth.vertebrae[:-1, 0], truth.vertebrae[:-1, 1]).max()
    print(
        f"at most {1e3 * (off_axis + RADIUS - BORE / 2):.2f} mm into the wall with {len(truth.contact_points)} contacts"
    )
    assert off_axis < BORE / 2 - RADIUS + 3e-4
    assert abs(truth.clearance_m) < 3e-4
    assert len(truth.contact_points) > 3
    np.testing.assert_allclose(np.hypot(*truth.contact_points[:, :2].T), BORE / 2, atol=5e-4)


def test_contact_is_felt_in_the_tendons() -> None:
    touching, free = inside("straight-pipe"), build_twin(WEIGHTLESS)
    for twin in (touching, free):
        bend(twin, 0.0)
    felt, unfelt = bend(touching, 0.5)[:12], bend(free, 0.5)[:12]
    print(f"largest tension {felt.max():.1f} N in the pipe, {unfelt.max():.1f} N in free space")
    assert felt.max() > unfelt.max() + 2.0


def test_what_the_walls_press_is_what_the_feed_has_to_hold() -> None:
    twin = inside("bent-pipe")
    bend(twin, 0.0)
    loads = bend(twin, 0.0, feed_m=0.45, seconds=5.0)
    pressed = twin.truth().contact_forces.sum(axis=0)
    assert pressed[2] < -0.05
    assert loads[FEED] == pytest.approx(-pressed[2], rel=0.05)


def test_pushed_into_a_bend_the_limp_robot_follows_it() -> None:
    twin = inside("bent-pipe")
    slack = np.full(14, 0.05)
    slack[12:] = 0.0, 0.3
    twin.advance(slack, 0.0)
    slack[FEED] = 0.52
    twin.advance(slack, 8.0)
    w, x, y, z = twin.truth().tip_wxyz
    ahead = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
    print(f"the tip has turned by {np.degrees(np.arccos(ahead[2])):.0f} degrees")
    assert ahead[0] > 0.8
    assert twin.truth().clearance_m > -5e-4
    assert twin.recoveries == 0


def test_fed_on_the_passive_body_follows_through_the_bend() -> None:
    twin = inside("bent-pipe")
    bend(twin, 0.0)
    bend(twin, 0.4, feed_m=0.55, seconds=5.0)
    bend(twin, 0.0, feed_m=0.8, seconds=5.0)
    truth = twin.truth()
    body = np.concatenate([truth.passive, truth.vertebrae])
    out = body[body[:, 2] > 0.01]
    walls = twin.environment
    assert walls
    distance, _ = walls.distance(out)
    assert (np.abs(out[:, 1]) < BORE / 2).all()
    # The pipe's centre line turns from +z to +x; nobody is closer to the wall than the body is thick.
    assert distance[:-1].min() > RADIUS - 0.0025
    assert truth.vertebrae[-1, 0] > 0.35
    assert np.linalg.norm(truth.vertebrae[0] - truth.passive[-1]) < 0.011
    assert twin.recoveries == 0


def test_pressed_from_the_wall_the_force_points_off_the_wall() -> None:
    twin = inside("straight-pipe")
    bend(twin, 0.0)
    twin.push(-1, np.array([0.4, 0.0, 0.0]))
    bend(twin, 0.0)
    truth = twin.truth()
    outward = truth.contact_points * [1.0, 1.0, 0.0]
    assert (np.einsum("ki,ki->k", truth.contact_forces, outward) <= 1e-9).all()
    assert truth.contact_forces.sum(axis=0)[0] < 0.0


def saved(folder: Path, name: str, mesh: trimesh.Trimesh) -> Path:
    path = folder / name
    mesh.export(path)
    return path


def shell(radius: float = 0.5) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=radius)


def test_what_a_closed_surface_winds_around_is_inside_it() -> None:
    triangles = shell().triangles
    assert winding(triangles, np.array([0.1, 0.2, 0.0])) == pytest.approx(1.0, abs=1e-6)
    assert winding(triangles, np.array([0.6, 0.0, 0.0])) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("ending", ["stl", "obj", "glb"])
def test_a_users_mesh_is_solid_where_it_has_been_put(tmp_path: Path, ending: str) -> None:
    plate = trimesh.creation.box((200.0, 200.0, 4.0))  # millimetres
    path = saved(tmp_path, f"plate.{ending}", plate)
    walls = environment(str(path), WEIGHTLESS, 0.001, (0.04, 0.0, 0.2, 0.0, 90.0, 0.0))
    assert walls
    np.testing.assert_allclose(np.ptp(walls.vertices, axis=0), [0.004, 0.2, 0.2], atol=1e-9)
    twin = build_twin(WEIGHTLESS, environment=walls)
    bend(twin, 0.0)
    bend(twin, 0.8)
    assert twin.truth().tip_position[0] + RADIUS < 0.038 + 0.006
    assert twin.truth().vertebrae[:, 0].max() < 0.040


@pytest.mark.parametrize(
    ("name", "mesh", "scale", "pose", "says"),
    [
        ("big.stl", shell(500.0), 1.0, (0.0,) * 6, ["1e+03 m across", "0.001 if it is in millimetres"]),
        ("small.stl", shell(0.0005), 1.0, (0.0,) * 6, ["0.001 m across", "1000"]),
        ("solid.stl", shell(), 1.0, (0.0,) * 6, ["swallows the entry port", "pose"]),
        (
            "wall.stl",
            trimesh.creation.box((0.2, 0.2, 0.004)),
            1.0,
            (0.0, 0.0, 0.2, 0.0, 0.0, 0.0),
            ["stands in the way", "meets the mesh at 198 mm"],
        ),
        ("shell.obj", shell(), -1.0, (0.0,) * 6, ["scale -1", "positive"]),
        ("shell.obj", shell(), 1.0, (0.0, np.nan, 0.0, 0.0, 0.0, 0.0), ["six finite numbers"]),
    ],
)
def test_a_mesh_that_cannot_be_walls_is_refused_with_what_would_be_right(
    tmp_path: Path, name: str, mesh: trimesh.Trimesh, scale: float, pose: tuple[float, ...], says: list[str]
) -> None:
    path = saved(tmp_path, name, mesh)
    with pytest.raises(WallsError) as error:
        environment(str(path), COBRA, scale, pose)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)
    for part in says:
        assert part in str(error.value)


@pytest.mark.parametrize("ending", ["stl", "obj", "glb"])
@pytest.mark.parametrize("content", [b"", b"no mesh at all", bytes(range(256)) * 4], ids=["empty", "text", "noise"])
def test_a_damaged_file_is_refused(tmp_path: Path, ending: str, content: bytes) -> None:
    path = tmp_path / f"damaged.{ending}"
    path.write_bytes(content)
    with pytest.raises(WallsError, match=r"damaged|no triangles"):
        environment(str(path), COBRA)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WallsError, match=r"nothing\.stl: cannot be read"):
        environment(str(tmp_path / "nothing.stl"), COBRA)


@pytest.mark.parametrize(
    ("option", "says"),
    [
        ({"world": "engnie"}, "world = 'engnie': must be one of free, straight-pipe"),
        ({"losses": "some"}, "losses = 'some'"),
        ({"gravity_m_s2": (0.0, 98.1, 0.0)}, "gravity"),
    ],
)
def test_options_that_cannot_be_are_refused(option: dict[str, object], says: str) -> None:
    with pytest.raises(SimulationError, match=says):
        Simulation(**option)  # type: ignore[arg-type]


def test_a_payload_that_would_fold_the_robot_is_refused() -> None:
    with pytest.raises(SimulationError, match=r"payload = 0\.5 kg: must be 0 to 0\.024 kg"):
        Simulation(payload_kg=0.5).true(COBRA)


def test_with_a_mesh_that_cannot_be_used_the_world_says_so_and_goes_on_without_it(tmp_path: Path) -> None:
    path = saved(tmp_path, "engine.stl", shell(500.0))
    options = {"stepping": "inline", "world": str(path)}
    robot = replace(COBRA, buses=(replace(COBRA.buses[0], options=options),))
    with open_bus(robot, ManualClock()):
        world = world_of("cobra")
        assert world.plant
        assert world.plant.environment is None
        assert len(world.notes) == 1
        assert world.notes[0].startswith(str(path))
        assert world.notes[0].endswith("going on in free space")


def test_a_large_mesh_is_measured_with_fewer_samples_and_still_right() -> None:
    ground = trimesh.creation.box((20.0, 20.0, 1.0))
    walls = Environment("ground", "ground", ground.vertices + np.array([0.0, 0.0, 1.5]), ground.faces)
    distance, _ = walls.distance(np.array([[0.3, 0.2, 0.0], [5.0, -5.0, 0.5]]))
    np.testing.assert_allclose(distance, [1.0, 0.5], atol=1e-9)
