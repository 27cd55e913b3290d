"""Independent references for the twin: constant curvature by integration, C-4 written out, and beams as a boundary problem."""

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from cobra.description import RobotDescription


def arc_chain(bends: np.ndarray, lengths: list[float], steps: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (3, 3) and position (3,) [m] of the end of arcs in series, by walking along the curve."""
    rotation, position = np.eye(3), np.zeros(3)
    for (bx, by), length in zip(bends, lengths, strict=True):
        along = (np.arange(steps) + 0.5) / steps
        tangents = Rotation.from_rotvec(np.outer(along, [-by, bx, 0.0])).as_matrix()[:, :, 2]
        position = position + rotation @ tangents.mean(axis=0) * length
        rotation = rotation @ Rotation.from_rotvec([-by, bx, 0.0]).as_matrix()
    return rotation, position


def shortening(description: RobotDescription, bends: np.ndarray) -> np.ndarray:
    """What each tendon is to be wound in for these bends (tendons,) [m]: C-4 with its sign turned."""
    wound = []
    for i, section in enumerate(description.sections):
        if section.routing:
            for azimuth in np.radians(section.routing.azimuths_deg):
                total = sum(b[0] * np.cos(azimuth) + b[1] * np.sin(azimuth) for b in bends[: i + 1])
                wound.append(section.routing.radius_m * total)
    return np.array(wound)


def cantilever(stiffness_Nm2: float, length_m: float, tip_N: float = 0.0, weight_N_m: float = 0.0) -> np.ndarray:
    """Tip (sideways, ahead) [m] of an elastica under a sideways tip force and its own weight, however far it bends."""

    def slopes(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        angle, curvature = y[0], y[1]
        force = tip_N + weight_N_m * (length_m - s)
        return np.array([curvature, -force * np.cos(angle) / stiffness_Nm2, np.sin(angle), np.cos(angle)])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0], b[1], a[2], a[3]])

    grid = np.linspace(0.0, length_m, 200)
    solution = solve_bvp(slopes, ends, grid, np.zeros((4, grid.size)), tol=1e-8)
    if not solution.success:
        raise RuntimeError(solution.message)
    return np.asarray(solution.y[2:, -1])
