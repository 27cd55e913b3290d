"""The twin bends as beam theory says: against Kirchhoff's rod as a boundary value problem, solved by collocation.

The twin is a chain of rigid pieces under MuJoCo's dynamics, the reference a continuous rod under static balance; they share
nothing but the stiffness. Claimed is 1 % of the length, along the whole rod, for small and large deflection.
"""

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_bvp

from cobra.loading import load_description
from cobra.simulation.losses import with_losses
from cobra.simulation.twin import build_twin

COBRA = with_losses(load_description("cobra"), "off", 0)
LENGTH = COBRA.active_length_m
EI, GJ = COBRA.sections[0].bending_stiffness_Nm2, COBRA.sections[0].torsional_stiffness_Nm2
WEIGHT = COBRA.backbone.mass_per_length_kg_m
SLACK = np.array([0.2] * 12 + [0.0, LENGTH])


def kirchhoff(force: np.ndarray, moment: np.ndarray, weight: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Positions (n, 3) at arc lengths (n,) of a clamped rod with tip force [N], tip moment [N·m] and weight [N/m].

    State: position, unit quaternion (w, x, y, z), moment in space. m' = −t × n, n = F + w (L − s); R' = R û, u = K⁻¹ Rᵀ m.
    The loads are raised in steps, each solution the next one's guess.
    """
    compliance = np.array([1 / EI, 1 / EI, 1 / GJ])

    def slopes(s: np.ndarray, y: np.ndarray, share: float) -> np.ndarray:
        w, a, b, c = y[3:7]
        R = np.array(
            [
                [1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)],
                [2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)],
                [2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)],
            ]
        )
        t = R[:, 2]
        n = share * (force[:, None] + weight[:, None] * (LENGTH - s))
        u = compliance[:, None] * np.einsum("ijk,ik->jk", R, y[7:10])
        turn = 0.5 * np.array(
            [
                -a * u[0] - b * u[1] - c * u[2],
                w * u[0] + b * u[2] - c * u[1],
                w * u[1] + c * u[0] - a * u[2],
                w * u[2] + a * u[1] - b * u[0],
            ]
        )
        return np.concatenate([t, turn, -np.cross(t, n, axis=0)])

    grid = np.linspace(0.0, LENGTH, 80)
    guess = np.zeros((10, grid.size))
    guess[2], guess[3] = grid, 1.0
    for share in (0.1, 0.25, 0.45, 0.7, 1.0):
        solution = solve_bvp(
            lambda s, y, k=share: slopes(s, y, k),
            lambda a, b, k=share: np.concatenate([a[:3], a[3:7] - [1, 0, 0, 0], b[7:] - k * moment]),
            grid,
            guess,
            tol=1e-6,
            max_nodes=20000,
        )
        assert solution.success, solution.message
        grid, guess = solution.x, solution.y
    return np.asarray(solution.sol(places)[:3].T)


CASES = {
    "small tip force": ((0.0015, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "large tip force": ((0.03, 0.04, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "tip force that pushes back": ((0.02, 0.0, -0.02), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "small tip moment": ((0.0, 0.0, 0.0), (0.0, 0.0008, 0.0), (0.0, 0.0, 0.0)),
    "large tip moment, 170 degrees": ((0.0, 0.0, 0.0), (0.0, 0.0119, 0.0), (0.0, 0.0, 0.0)),
    "its weight, little gravity": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.3, 0.0)),
    "its weight, level": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 9.81, 0.0)),
    "its weight, upwards at a slant": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (3.0, 0.0, -4.0)),
    "all of them, out of one plane": ((0.0, 0.015, 0.01), (-0.002, 0.003, 0.003), (2.0, 1.0, 3.0)),
}


@pytest.mark.parametrize("case", CASES)
def test_along_its_whole_length_it_lies_where_kirchhoffs_rod_lies(case: str) -> None:
    force, moment, gravity = (np.array(part) for part in CASES[case])
    twin = build_twin(replace(COBRA, backbone=replace(COBRA.backbone, gravity_m_s2=tuple(gravity))))
    twin.advance(SLACK, 0.0)
    twin.push(-1, force, moment)
    twin.advance(SLACK, 10.0)
    lies = twin.truth().vertebrae
    places = np.linspace(0.0, LENGTH, len(lies) + 1)[1:]
    should = kirchhoff(force, moment, WEIGHT * gravity, places)
    off = np.linalg.norm(lies - should, axis=1)
    bent = np.linalg.norm(should[-1] - [0.0, 0.0, LENGTH]) / LENGTH
    print(f"{case}: tip moved by {100 * bent:.1f} % of the length, off by at most {100 * off.max() / LENGTH:.2f} %")
    assert off.max() < 0.01 * LENGTH
    # Small deflections are not hidden in that: they are right to 2 % of themselves.
    assert off.max() < 0.02 * LENGTH * bent + 1e-6
