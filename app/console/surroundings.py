"""What stands still in the 3D view: up, first camera, floor, entry port with introducer, and the body that goes away."""

import numpy as np
import viser

from app.console import appearance
from app.console.meshes import Floats, Indices, lathe, quaternions, sweep, sweep_faces, unit_circle
from cobra.description import RobotDescription
from cobra.kinematics import section

INTRODUCER_SHARE = 0.2
"""Drawn length of the introducer, as a share of the active length."""
FOV_RAD = 0.7
BOLTS = 6
FADING_PIECES = 7


def introducer_length_m(description: RobotDescription) -> float:
    return INTRODUCER_SHARE * description.active_length_m


def up_direction(description: RobotDescription) -> Floats:
    """Away from gravity (3,); −y where there is none."""
    gravity = np.asarray(description.backbone.gravity_m_s2, dtype=float)
    norm = np.linalg.norm(gravity)
    return -gravity / norm if norm > 0.0 else np.array([0.0, -1.0, 0.0])


def hangs(description: RobotDescription) -> bool:
    """Whether the robot enters downwards, rather than sideways."""
    return bool(abs(up_direction(description)[2]) > 0.5)


def first_camera(description: RobotDescription) -> tuple[Floats, Floats]:
    """Position and look-at (3,) [m]: a three-quarter view from above, from behind the port or across it.

    In both, +x is to the right and −y up or away, as on the sticks.
    """
    length, up = description.active_length_m, up_direction(description)
    if hangs(description):
        look_at, aside, height = np.array([0.0, 0.0, 0.44]), np.array([0.62, 1.55, 0.0]), 0.62
    else:
        look_at, aside, height = np.array([0.06, 0.0, 0.42]) - 0.04 * up, np.array([1.10, 0.0, -0.84]), 0.64
    return length * (look_at + aside + height * up), length * look_at


def add_surroundings(server: viser.ViserServer, description: RobotDescription) -> None:
    """Draw all of it, once."""
    up = up_direction(description)
    server.scene.set_up_direction(tuple(up))
    camera = server.initial_camera
    camera.position, camera.look_at = first_camera(description)
    camera.fov = FOV_RAD
    # Close planes: shadows and depth are fitted between them.
    camera.near, camera.far = 0.02 * description.active_length_m, 20.0 * description.active_length_m
    appearance.light(server)
    _add_floor(server, description, up)
    _add_port(server, description)
    if description.backbone.total_length_m > description.active_length_m:
        _add_passive_body(server, description, up)


def _add_floor(server: viser.ViserServer, description: RobotDescription, up: Floats) -> None:
    """A grid for reference that takes the robot's shadow; it is no obstacle."""
    length = description.active_length_m
    server.scene.add_grid(
        "/floor",
        plane="xz",
        wxyz=quaternions(_rotation_of_y_to(up)[None])[0],
        position=-(1.3 if hangs(description) else 0.4) * length * up,
        infinite_grid=True,
        fade_distance=5.0 * length,
        fade_strength=1.5,
        cell_size=0.05,
        section_size=0.25,
        cell_color=(70, 82, 96),
        section_color=(92, 106, 124),
        cell_thickness=0.6,
        section_thickness=0.9,
        shadow_opacity=0.35,
    )


def _add_port(server: viser.ViserServer, description: RobotDescription) -> None:
    """A flange plate with a hole at z = 0, its bolts, and the introducer through it."""
    hole = 1.06 * description.backbone.diameter_m / 2.0
    unit = 0.01 * description.active_length_m
    rim, bore = hole + 10.0 * unit, hole + 1.3 * unit
    plate = (
        (-2.0 * unit, bore),
        (-2.0 * unit, rim - 0.5 * unit),
        (-1.5 * unit, rim),
        (-0.5 * unit, rim),
        (0.0, rim - 0.5 * unit),
        (0.0, bore),
    )
    _add_solid(server, "/port/plate", *lathe(plate, 72), appearance.PLATE)
    back = -introducer_length_m(description)
    tube = (
        (back, hole),
        (back, bore - 0.4 * unit),
        (back + 0.4 * unit, bore),
        (2.2 * unit, bore),
        (2.6 * unit, bore - 0.4 * unit),
        (2.6 * unit, hole),
        (back, hole),
    )
    _add_solid(server, "/port/introducer", *lathe(tube, 48), appearance.INTRODUCER)
    head = ((0.0, 1.1), (1.0, 1.1), (1.3, 0.8), (1.3, 0.55), (0.7, 0.5), (0.7, 0.0))
    vertices, faces = lathe(tuple((z * unit, r * unit) for z, r in head), 24)
    angle = np.linspace(0.0, 2.0 * np.pi, BOLTS, endpoint=False) + np.pi / BOLTS
    circle = 0.5 * (rim + bore) + 0.8 * unit
    server.scene.add_batched_meshes_simple(
        "/port/bolts",
        vertices,
        faces,
        batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (BOLTS, 1)),
        batched_positions=circle * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1),
        batched_colors=appearance.linear(appearance.BOLT),
        lod="off",
    )


def _add_passive_body(server: viser.ViserServer, description: RobotDescription, up: Floats) -> None:
    """The passive body behind the introducer, curving and fading away towards the actuation pack."""
    length = 0.9 * description.active_length_m
    down = np.array([-1.0, 0.0]) if hangs(description) else -up[:2]
    # Seen from the introducer's back end, which looks along −z.
    turn = np.diag([1.0, -1.0, -1.0])
    share = np.linspace(0.0, 1.0, 4 * FADING_PIECES + 1)
    bends = 1.1 * share[:, None] * (turn[:2, :2] @ down)
    points = section.translation(bends, share * length) @ turn.T
    points[:, 2] -= 0.9 * introducer_length_m(description)
    rotations = turn @ section.rotation(bends)
    circle = unit_circle(24)
    for piece in range(FADING_PIECES):
        own = slice(4 * piece, 4 * piece + 5)
        radii = np.full(5, description.backbone.diameter_m / 2.0)
        server.scene.add_mesh_simple(
            f"/port/body/{piece}",
            sweep(points[own], rotations[own], radii, circle),
            sweep_faces(5, len(circle)),
            color=appearance.TUBE,
            opacity=None if piece == 0 else 1.0 - piece / FADING_PIECES,
            cast_shadow=piece < FADING_PIECES // 2,
        )


def _add_solid(server: viser.ViserServer, name: str, vertices: Floats, faces: Indices, color: appearance.Rgb) -> None:
    server.scene.add_mesh_simple(name, vertices, faces, color=color)


def _rotation_of_y_to(direction: Floats) -> Floats:
    """A rotation (3, 3) whose y axis is `direction` (3,)."""
    helper = np.eye(3)[np.argmin(np.abs(direction))]
    x = np.cross(direction, helper)
    x /= np.linalg.norm(x)
    return np.stack([x, direction, np.cross(x, direction)], axis=1)
