"""A beam as an independent witness of SRC-Bot's statics: scipy's boundary value solver, none of the program's own mechanics."""

import numpy as np
from scipy.integrate import solve_bvp


def beam(parameters, forces):
    """Guiders (n + 1, 2) in the x-z plane: an extensible elastica with forces (n, 2) at its stations, by solve_bvp.

    All pieces between stations are solved at once, each over 0 … 1: angle, moment, x, z; EI θ' = M, M' = −ν t × N,
    ν = 1 + N·t / EA, EA = K L₀.
    """
    p, n = parameters, parameters.segments
    carried = np.cumsum(forces[::-1], axis=0)[::-1]

    def slopes(_, y):
        out = []
        for i in range(n):
            angle, moment = y[4 * i], y[4 * i + 1]
            x, z = np.sin(angle), np.cos(angle)
            stretch = 1.0 + (carried[i, 0] * x + carried[i, 1] * z) / (p.axial_stiffness_N_m * p.rest_length_m)
            turning = stretch * (z * carried[i, 0] - x * carried[i, 1])
            out += [moment / p.bending_stiffness_Nm2, -turning, stretch * x, stretch * z]
        return p.rest_length_m * np.array(out)

    def ends(begin, end):
        joints = [begin[4 * i + 4 : 4 * i + 8] - end[4 * i : 4 * i + 4] for i in range(n - 1)]
        return np.concatenate([begin[[0, 2, 3]], *joints, [end[4 * n - 3]]])

    found = solve_bvp(slopes, ends, np.linspace(0.0, 1.0, 11), np.zeros((4 * n, 11)), tol=1e-8, max_nodes=20000)
    assert found.success
    return np.vstack([[0.0, 0.0], found.y[:, -1].reshape(n, 4)[:, 2:]])
