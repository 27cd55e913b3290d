"""Loss parameters from a guided sweep: what the drives said while the robot was tightened, loosened and bent to and fro.

Only feedback of the drives enters: travel, speed, load. For given parameters every sample gives the tensions along each
tendon (friction follows from the past, as in `estimation.py`) and the tendons' lengths y at the port. More tendons than
bends: so their lengths must fit a shape,

    (I − G G⁺) y = 0,

and pretension, which bends nothing, must not change them. Maximum of the posterior by robust least squares; the prior is
the description within ±30 %. Routing radii and bending stiffnesses do not show in lengths alone: they keep their prior,
and come from a kinematic calibration.
"""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.kinematics.kernels import compiled
from cobra.mechanics.losses import DESCRIBED_SPREAD, Identified, Losses, described
from cobra.mechanics.tendon_balance import TendonBalance

Floats = NDArray[np.float64]

PRIOR = DESCRIBED_SPREAD / np.sqrt(3.0)
MOVING_M_S = 5e-5
CONDUIT_PARTS = 6
EVALUATED = 1000
"""Samples that are compared, evenly over the sweep."""
LENGTH_SIGMA_M = 3e-5
"""Unround spools and whole counts of the current."""
INDEPENDENT = 0.1
"""Share of the evaluated samples that count: neighbours share their errors."""
SLACK_N = 0.3
"""Samples with a slack tendon are left out: its length says nothing."""
LEAST_SAMPLES = 200
LARGEST_CHANGE = 0.6
"""Of any parameter, as a logarithm."""


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


NAMES = ("axial_stiffness_N", "drive_friction_N", "backlash_m", "hole_friction", "conduit_capstan")
"""What the sweep shows; the parameter vector is the logarithm of each over the description's."""


def identify(description: RobotDescription, sweep: Sweep, label: str = "a guided sweep") -> Identified:
    """The losses that explain a sweep best, and how sure each is.

    Raises:
        SweepError: too few samples, or tendons that never moved both ways.
    """
    _check(description, sweep)
    nominal = described(description)
    balance = TendonBalance(description, nominal.losses)
    at = np.unique(np.linspace(0, len(sweep.time_s) - 1, EVALUATED).astype(int))

    def cost(x: Floats) -> Floats:
        return np.concatenate([_residuals(balance, _losses(x, nominal.losses), sweep, at), x / PRIOR])

    limit = LARGEST_CHANGE
    fit = least_squares(
        cost, np.zeros(len(NAMES)), loss="soft_l1", bounds=(-limit, limit), x_scale=PRIOR, diff_step=1e-3
    )
    spread = np.sqrt(np.diag(np.linalg.inv(fit.jac.T @ fit.jac)))
    losses = _losses(fit.x, nominal.losses)
    parts: dict[str, Any] = {name: np.abs(getattr(losses, name)) * spread[i] for i, name in enumerate(NAMES)}
    return Identified(losses, replace(nominal.deviation, **parts), label)


def _losses(x: Floats, nominal: Losses) -> Losses:
    parts: dict[str, Any] = {name: getattr(nominal, name) * np.exp(x[i]) for i, name in enumerate(NAMES)}
    return replace(nominal, **parts)


def _check(description: RobotDescription, sweep: Sweep) -> None:
    if len(sweep.time_s) < LEAST_SAMPLES:
        raise SweepError(f"only {len(sweep.time_s)} samples came from the robot; at least {LEAST_SAMPLES} are needed")
    for j, name in enumerate(description.tendon_names):
        speed = sweep.velocity[:, j]
        if not (np.any(speed > MOVING_M_S) and np.any(speed < -MOVING_M_S)):
            raise SweepError(f"tendon {name} did not move both ways: let the sweep run to its end")


def _residuals(balance: TendonBalance, losses: Losses, sweep: Sweep, at: NDArray[np.int64]) -> Floats:
    """What no shape explains of the lengths at the samples `at`, in standard deviations."""
    friction, backlash = losses.drive_friction_N, losses.backlash_m
    motor, spool = _follow_drives(sweep.travel, sweep.velocity, sweep.load, friction, backlash)
    passes = np.arange(len(balance.section_lengths_m))[None, :] <= balance.section_of[:, None]
    own = np.where(passes, balance.section_lengths_m, 0.0)
    compliance = (balance.conduit_m + own.sum(axis=1)) / losses.axial_stiffness_N
    rough = (spool + (motor - motor[0]) * compliance) @ balance.inverse.T
    angles = np.zeros((len(motor), len(balance.section_lengths_m)))
    for i in dict.fromkeys(balance.column_section.tolist()):
        angles[:, i] = np.linalg.norm(rough[:, balance.column_section == i], axis=1)
    tension = _follow_tendons(motor, angles, losses.conduit_capstan, losses.hole_friction, CONDUIT_PARTS)
    parts = np.full((len(friction), CONDUIT_PARTS), balance.conduit_m / CONDUIT_PARTS)
    carried = np.concatenate([parts, own], axis=1)
    means = (tension[:, :, :-1] + tension[:, :, 1:]) / 2
    length = spool[at] - spool[0] + ((means[at] - means[0]) * carried).sum(axis=2) / losses.axial_stiffness_N
    misfit = length - length @ balance.inverse.T @ balance.slopes.T
    taut = np.all(tension[at, :, 0] > SLACK_N, axis=1)[:, None]
    return np.sqrt(INDEPENDENT) * (taut * misfit / LENGTH_SIGMA_M).ravel()


@compiled
def _follow_drives(travel: Any, velocity: Any, load: Any, friction: Any, backlash: Any) -> Any:
    """Tension at the spools and the spools' travel (N, m): gear friction and play taken off, as they follow from the past."""
    motor, spool = np.empty_like(load), np.empty_like(travel)
    for j in range(travel.shape[1]):
        # Homing ends drawing in.
        held, end = load[0, j] - friction[j], travel[0, j] + backlash[j] / 2
        for i in range(travel.shape[0]):
            if abs(velocity[i, j]) > MOVING_M_S:
                held = load[i, j] + np.sign(velocity[i, j]) * friction[j]
            else:
                held = min(max(held, load[i, j] - friction[j]), load[i, j] + friction[j])
            held = max(held, 0.0)
            motor[i, j] = held
            end = min(max(end, travel[i, j] - backlash[j] / 2), travel[i, j] + backlash[j] / 2)
            spool[i, j] = end
    return motor, spool


@compiled
def _follow_tendons(motor: Any, angles: Any, capstan: float, friction: float, parts: int) -> Any:
    """Tensions (N, m, parts + sections + 1) at the ends of the conduit's parts and of the sections, motor first."""
    count, tendons = motor.shape
    places = parts + angles.shape[1] + 1
    out = np.empty((count, tendons, places))
    step = np.exp(capstan / parts)
    for i in range(count):
        for j in range(tendons):
            out[i, j, 0] = motor[i, j]
            for p in range(1, places):
                ratio = step if p <= parts else np.exp(friction * angles[i, p - parts - 1])
                before = out[i, j, p - 1]
                if i == 0:
                    out[i, j, p] = before / ratio
                else:
                    out[i, j, p] = min(max(out[i - 1, j, p], before / ratio), before * ratio)
    return out
