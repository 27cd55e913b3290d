"""A user's own mesh as an environment: STL, OBJ or GLB, with scale and pose; what cannot be is refused in words."""

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from cobra.description import RobotDescription
from cobra.simulation.environments.surface import Environment, Floats, WallsError

MAX_TRIANGLES = 400_000
LARGEST_M = 30.0
"""No robot of ours gets lost in more."""
SMALLEST = 2.0
"""Largest extent, of the body's diameter."""
UNITS = {0.001: "millimetres", 0.0254: "inches", 0.01: "centimetres", 1000.0: "kilometres"}


def from_file(path: Path, d: RobotDescription, scale: float = 1.0, pose: tuple[float, ...] = (0.0,) * 6) -> Environment:
    """Load, scale and place a mesh.

    Args:
        path: of the mesh.
        d: the robot that shall move in it.
        scale: metres per unit of the file.
        pose: x, y, z [m] of the mesh's origin in the frame of the port, and its rotation about x, y and z, one after the
            other about fixed axes [degrees].

    Raises:
        WallsError: it cannot be read, is not in metres by any sane measure, or swallows the entry port.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise WallsError(f"{path}: scale {scale:g}: must be a positive number, metres per unit of the file")
    if len(pose) != 6 or not np.isfinite(pose).all():
        raise WallsError(f"{path}: pose {pose}: must be six finite numbers, x y z in metres and three degrees")
    mesh = _read(path)
    _check_size(path, mesh, d, scale)
    turn = Rotation.from_euler("xyz", pose[3:], degrees=True).as_matrix()
    vertices = np.asarray(mesh.vertices, dtype=np.float64) * scale @ turn.T + pose[:3]
    placed = Environment(path.stem, path.name, vertices, np.asarray(mesh.faces, dtype=np.int64))
    _check_port(path, placed, d)
    return placed


def _read(path: Path) -> Any:
    if not path.is_file():
        raise WallsError(f"{path}: cannot be read (there is no such file)")
    try:
        mesh: Any = trimesh.load(path, force="mesh")
    except OSError as error:
        raise WallsError(f"{path}: cannot be read ({error.strerror or error})") from None
    except Exception as error:
        # The readers of three formats fail in as many ways on a damaged file.
        raise WallsError(f"{path}: damaged, or no {path.suffix[1:].upper()} ({type(error).__name__})") from None
    vertices = np.asarray(getattr(mesh, "vertices", ()))
    if not len(vertices) or not len(mesh.faces):
        raise WallsError(f"{path}: holds no triangles")
    if not np.isfinite(vertices).all():
        raise WallsError(f"{path}: damaged: some of its points are not finite numbers")
    if len(mesh.faces) > MAX_TRIANGLES:
        raise WallsError(
            f"{path}: {len(mesh.faces)} triangles are too many to touch in real time; reduce it to {MAX_TRIANGLES}"
        )
    return mesh


def _check_size(path: Path, mesh: Any, d: RobotDescription, scale: float) -> None:
    size = float(np.ptp(np.asarray(mesh.vertices), axis=0).max()) * scale
    smallest = SMALLEST * d.backbone.diameter_m
    if smallest <= size <= LARGEST_M:
        return
    fits = [f"{s:g} if it is in {unit}" for s, unit in UNITS.items() if smallest <= size * s / scale <= LARGEST_M]
    hint = f"; try scale {', or '.join(fits)}" if fits else ""
    raise WallsError(
        f"{path}: {size:.3g} m across with scale {scale:g}: it must be {smallest:.3g} to {LARGEST_M:g} m, "
        f"in which a robot {1e3 * d.backbone.diameter_m:g} mm thin can move{hint}"
    )


def _check_port(path: Path, environment: Environment, d: RobotDescription) -> None:
    """The body must come through the port, and stand free where it starts."""
    radius = d.backbone.diameter_m / 2
    reach = d.feed.start_m if d.feed else d.active_length_m
    z = np.arange(0.0, reach + radius, radius / 2)
    distance, places = environment.distance(np.stack([0 * z, 0 * z, z], axis=1))
    blocked = distance < radius
    move = "move or turn it with the pose"
    if blocked[0] or _inside(environment, np.zeros(3)):
        raise WallsError(f"{path}: swallows the entry port: the port at 0 0 0 lies in its material; {move}")
    if blocked.any():
        at = places[np.argmax(blocked)][2]
        raise WallsError(
            f"{path}: stands in the way: the robot starts straight, {1e3 * reach:.0f} mm out of the port along z, and meets "
            f"the mesh at {1e3 * at:.0f} mm; {move}"
        )


def _inside(environment: Environment, point: Floats) -> bool:
    """Whether a point lies in the material of a closed mesh; an open one has no inside."""
    mesh = trimesh.Trimesh(environment.vertices, environment.faces, process=True)
    if not mesh.is_watertight:
        return False
    # A hollow body has a wall outside and one inside: a ray from its hollow crosses two.
    return winding(mesh.vertices[mesh.faces], point) > 0.5


def winding(triangles: Floats, point: Floats) -> float:
    """How often closed triangles (m, 3, 3) wind around a point: 1 inside, 0 outside (van Oosterom and Strackee 1983)."""
    a, b, c = np.moveaxis(triangles - point, 1, 0)
    la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    rest = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
    return float(abs(np.arctan2(volume, rest).sum() / (2 * np.pi)))
