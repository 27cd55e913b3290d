"""Loss parameters from a guided sweep: what the drives said while the robot was tightened, loosened and bent to and fro.

Only feedback of the drives enters: travel, speed, load. For given parameters the model of `rubbing.py` follows the travel
and foretells the tension at every spool; the parameters are those that foretell what the drives felt,

    load = T_motor − f sign(v) while the drive moves, within ± f of T_motor while it stands,

as the maximum of the posterior by robust least squares (Levenberg–Marquardt, reweighted); the prior is the description
within ±30 %. How lengths change stiffness tells EA, what a reversal costs tells friction and play, and how the tendons of
one section feel the bends of the others tells the ratios of routing radii and bending stiffnesses. Their common scale shows
in the weight alone, which is known: a robot that hangs or is weightless in its own plane tells it less well.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.kinematics.configuration import Configuration
from cobra.mechanics.losses import DESCRIBED_SPREAD, Identified, Losses, described
from cobra.mechanics.rubbing import Rubbing

Floats = NDArray[np.float64]

PRIOR = DESCRIBED_SPREAD / np.sqrt(3.0)
SETTLING_PRIOR = 0.7
"""Nobody has described it: a factor of two."""
MOVING_M_S = 5e-5
STEP_S = 0.05
"""Samples are compared at this distance."""
TENSION_SIGMA_N = 0.08
"""Unround spools, whole counts of the current, and what the model leaves out."""
INDEPENDENT = 0.05
"""Share of the samples that count: neighbours share their errors."""
ROBUST = 2.0
"""Standard deviations beyond which a sample counts less."""
LEAST_S = 20.0
LARGEST_CHANGE = 0.6
"""Of any parameter, as a logarithm."""
ITERATIONS = 10
DIFFERENCE = 0.01
DONE = 1e-3
"""A relative change of the cost by less ends the search."""
MAX_STEP = 0.2
DAMPINGS = 5


class SweepError(OperatorError):
    """A sweep that says nothing. The message says what is missing."""


class Sweep(NamedTuple):
    """What the drives said from homing on; N samples, m tendons."""

    time_s: Floats
    """(N,)"""
    travel: Floats
    """(N, m) [m], 0 at home"""
    velocity: Floats
    """(N, m) [m/s]"""
    load: Floats
    """(N, m) [N] of the drives, gear friction included"""


NAMES = ("axial_stiffness_N", "drive_friction_N", "backlash_m", "hole_friction", "conduit_capstan", "settling_s")
"""What the sweep shows for all tendons and sections in common."""
EACH = ("radius_m", "bending_stiffness_Nm2")
"""And for each active section. The parameter vector is the logarithm of each over the description's."""


def identify(description: RobotDescription, sweep: Sweep, label: str = "a guided sweep") -> Identified:
    """The losses that explain a sweep best, and how sure each is.

    Raises:
        SweepError: too few samples, or tendons that never moved both ways.
    """
    _check(description, sweep)
    nominal = described(description)
    vector = _Vector(description, nominal.losses)
    even = _evenly(sweep)

    def misfit(x: Floats) -> Floats:
        return _misfit(description, vector.losses(x), even)

    x, spread = _search(misfit, vector.prior)
    losses = vector.losses(x)
    return Identified(losses, replace(nominal.deviation, **vector.deviations(losses, spread)), label)


class _Vector:
    """Between losses and the parameter vector (p,)."""

    def __init__(self, description: RobotDescription, nominal: Losses) -> None:
        self._nominal = nominal
        # Without friction in the description there is nothing to scale.
        self._common = [name for name in NAMES if np.any(np.asarray(getattr(nominal, name)) > 0.0)]
        self._active = np.array(description.active_sections, dtype=np.int64)
        prior = [SETTLING_PRIOR if name == "settling_s" else PRIOR for name in self._common]
        self.prior = np.array(prior + [PRIOR] * len(EACH) * len(self._active))

    def _parts(self, x: Floats) -> dict[str, Any]:
        """Each parameter's own entries of x, in its shape."""
        out: dict[str, Any] = {name: x[i] for i, name in enumerate(self._common)}
        for k, name in enumerate(EACH):
            own = np.zeros(np.shape(getattr(self._nominal, name)))
            start = len(self._common) + k * len(self._active)
            own[self._active] = x[start : start + len(self._active)]
            out[name] = own
        return out

    def losses(self, x: Floats) -> Losses:
        parts = {name: getattr(self._nominal, name) * np.exp(value) for name, value in self._parts(x).items()}
        return replace(self._nominal, **parts)

    def deviations(self, losses: Losses, spread: Floats) -> dict[str, Any]:
        return {name: np.abs(getattr(losses, name)) * value for name, value in self._parts(spread).items()}


def _search(misfit: Any, prior: Floats) -> tuple[Floats, Floats]:
    """The parameters of least robust cost and their standard deviations (p,)."""
    x = np.zeros(len(prior))
    residual = misfit(x)
    cost = _cost(residual, x / prior)
    damping = 1e-3
    for _ in range(ITERATIONS):
        slopes = np.stack([(misfit(x + step) - residual) / DIFFERENCE for step in DIFFERENCE * np.eye(len(x))], axis=1)
        weight = 1.0 / np.sqrt(1.0 + (residual / ROBUST) ** 2)
        normal = slopes.T @ (weight[:, None] * slopes) + np.diag(prior**-2.0)
        gradient = slopes.T @ (weight * residual) + x / prior**2
        before = cost
        for _damping in range(DAMPINGS):
            change = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), gradient)
            trial = np.clip(x - np.clip(change, -MAX_STEP, MAX_STEP), -LARGEST_CHANGE, LARGEST_CHANGE)
            there = misfit(trial)
            reached = _cost(there, trial / prior)
            if reached < cost:
                x, residual, cost = trial, there, reached
                damping = max(damping / 10.0, 1e-4)
                break
            damping = max(10.0 * damping, 1e-2)
        if before - cost < DONE * cost:
            break
    return x, np.sqrt(np.diag(np.linalg.inv(normal)))


def _cost(residual: Floats, beside: Floats) -> float:
    robust = ROBUST**2 * (np.sqrt(1.0 + (residual / ROBUST) ** 2) - 1.0)
    return float(np.sum(robust) + 0.5 * np.sum(beside**2))


def _check(description: RobotDescription, sweep: Sweep) -> None:
    seconds = float(sweep.time_s[-1] - sweep.time_s[0]) if len(sweep.time_s) else 0.0
    if seconds < LEAST_S:
        raise SweepError(f"only {seconds:.0f} s came from the robot; at least {LEAST_S:.0f} s are needed")
    for j, name in enumerate(description.tendon_names):
        speed = sweep.velocity[:, j]
        if not (np.any(speed > MOVING_M_S) and np.any(speed < -MOVING_M_S)):
            raise SweepError(f"tendon {name} did not move both ways: let the sweep run to its end")


def _evenly(sweep: Sweep) -> Sweep:
    """At even steps in time; what was missed on the way is taken to have gone evenly."""
    time = np.arange(sweep.time_s[0], sweep.time_s[-1], STEP_S)

    def at(values: Floats) -> Floats:
        return np.stack([np.interp(time, sweep.time_s, column) for column in values.T], axis=1)

    return Sweep(time, at(sweep.travel), at(sweep.velocity), at(sweep.load))


def _misfit(description: RobotDescription, losses: Losses, sweep: Sweep) -> Floats:
    """What the model does not foretell of the loads, in standard deviations, each counted as far as it is independent."""
    model = Rubbing(description, losses)
    friction = losses.drive_friction_N
    model.reset(np.maximum(sweep.load[0] - friction, 0.0))
    home = np.tile(Configuration(description).home(), (len(sweep.time_s), 1))
    tension, _ = model.follow(sweep.travel, home, losses.backlash_m, STEP_S)
    moving = np.abs(sweep.velocity) > MOVING_M_S
    above = sweep.load - tension
    felt = np.where(
        moving,
        above + friction * np.sign(sweep.velocity),
        np.sign(above) * np.maximum(np.abs(above) - friction, 0.0),
    )
    return np.sqrt(INDEPENDENT) * (felt / TENSION_SIGMA_N).ravel()
