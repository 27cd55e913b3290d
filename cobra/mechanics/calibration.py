"""Kinematic calibration: fit a robot model to motor positions against measured tip poses.

Nonlinear least squares over all samples in their order, with a robust loss on the tip and the prior of `robot_model.py`.
Neighbouring samples share their errors, so each counts for less than one; block-wise sums of the gradient tell the
parameters' uncertainty honestly (`calibration_report.py`). Nothing here looks at any other recording than the one given.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cobra.errors import OperatorError
from cobra.mechanics.recordings import Recording
from cobra.mechanics.robot_model import Nominal, RobotModel, Values, blocks, poses
from cobra.mechanics.tendon_statics import TANGENT_STEP, Drive, log_age, solve, solve_with_tangents

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]

ROBUST = 0.01
"""Tip errors beyond this share of the robot's length count linearly, not squared."""
MOST_DOUBT = 0.05
LEAST_DOUBT = 0.002
"""A sample weighs as if its tip were uncertain by a share of the length between these: the error that the fit leaves,
times the root of how many neighbours make one independent sample."""
SURER = 0.7
"""Fit once more where the doubt falls under this share of what was assumed,"""
ROUNDS = 3
"""this often at most."""
MOST_ALIKE = 0.95
TURN_LENGTH = 0.25
"""An orientation's error counts as a tip error at this share of the length."""
GAP = 2.0
"""Samples farther apart than this many median intervals do not tell how fast the tendons moved."""
START_SAMPLES = 150
YAWS = 12
FIRST_LOOK = 5
HOPEFUL = 6
SECOND_LOOK = 12
"""Starts are followed for a few steps, and the best of them for more."""
BEND_STEP = 1e-6
LEAST_MOVING_SAMPLES = 30


@dataclass(frozen=True)
class Sequence:
    """A recording in the terms of a model: what drove it, and what was seen."""

    drive: Drive
    tip_m: Floats
    turn: Floats | None
    """(N, 3, 3)"""
    block: NDArray[np.int64]

    def every(self, step: int) -> "Sequence":
        """Each step-th sample, for a first look; the past between them is lost."""
        return Sequence(
            Drive(*(part[::step] for part in self.drive)),
            self.tip_m[::step],
            None if self.turn is None else self.turn[::step],
            self.block[::step],
        )


@dataclass(frozen=True)
class Fit:
    """A model with its parameters."""

    model: RobotModel
    x: Floats
    """(size,) whitened"""
    cost: float
    doubt: float = MOST_DOUBT
    """Uncertainty of a sample, as a share of the robot's length"""

    @property
    def values(self) -> Values:
        return self.model.values(self.x)


@dataclass(frozen=True)
class Calibration:
    """A fitted robot with what is needed to apply it to another recording."""

    fit: Fit
    reference_s: float
    """When its tendons began to age, on the recording's clock."""
    sign: int
    """−1: the recording's travel had the other sign."""

    def sequence(self, recording: Recording) -> Sequence:
        """A recording of this robot in the terms of the model."""
        return sequence(recording, self.fit.model.robot, reference_s=self.reference_s, sign=self.sign)


def sequence(recording: Recording, robot: Nominal, *, reference_s: float, sign: int = 1) -> Sequence:
    """A recording in the units of the statics. Tendons age from `reference_s`; `sign` −1 turns all travel round."""
    wound = -sign * recording.paid_out_m / robot.radius_m
    turn = None
    if recording.tip_wxyz is not None:
        turn = Rotation.from_quat(recording.tip_wxyz, scalar_first=True).as_matrix()
    rate = _rates(recording.time_s, wound)
    return Sequence(Drive(wound, rate, log_age(recording.time_s - reference_s)), recording.tip_m, turn, recording.block)


def _rates(time_s: Floats, wound: Floats) -> Floats:
    """Mean of the rates before and after each sample, of those intervals that are short enough to tell."""
    if len(time_s) < 2:
        return np.zeros_like(wound)
    interval = np.diff(time_s)
    known = interval < GAP * np.median(interval)
    rate = np.where(known[:, None], np.diff(wound, axis=0) / interval[:, None], 0.0)
    total, count = np.zeros_like(wound), np.zeros(len(wound))
    total[1:] += rate
    total[:-1] += rate
    count[1:] += known
    count[:-1] += known
    return total / np.maximum(count, 1.0)[:, None]


def predict(fit: Fit, seen: Sequence) -> tuple[Floats, Floats, Floats]:
    """Tip positions (N, 3) [m], rotations (N, 3, 3) and bends (N, 2n) [rad] that the model gives for what drove it."""
    values = fit.values
    bends = solve(fit.model.springs(values), seen.drive, fit.model.robot.ends, slack=fit.model.slack)
    place, turn = poses(values, bends)
    return place, turn, bends


def tip_errors(fit: Fit, seen: Sequence) -> Floats:
    """Distance of predicted from measured tips (N,) [m]."""
    return np.asarray(np.linalg.norm(predict(fit, seen)[0] - seen.tip_m, axis=-1))


def adjust(start: Fit, seen: Sequence, rows: Rows | None = None, *, iterations: int = 40) -> Fit:
    """Fit the model to the chosen rows (all by default); all rows drive it, since the past matters.

    How much the samples weigh against the prior is estimated from what the fit leaves.

    Raises:
        OperatorError: fewer samples than parameters.
    """
    rows = np.ones(len(seen.tip_m), dtype=np.bool_) if rows is None else rows
    if int(rows.sum()) * seen.tip_m.shape[1] < start.model.size:
        raise OperatorError(f"{int(rows.sum())} samples cannot tell {start.model.size} parameters; record more")
    fit = start
    for _ in range(ROUNDS):
        fit = _adjust(fit, seen, rows, iterations)
        doubt = _doubt(fit, seen, rows)
        if doubt > SURER * fit.doubt:
            break
        fit = replace(fit, doubt=doubt)
    return fit


def _doubt(fit: Fit, seen: Sequence, rows: Rows) -> float:
    error = (predict(fit, seen)[0] - seen.tip_m)[rows]
    power = float(np.sum(error * error))
    alike = float(np.sum(error[1:] * error[:-1])) / power if power > 0.0 else 0.0
    alike = min(max(alike, 0.0), MOST_ALIKE)
    share = np.sqrt(power / error.shape[0] * (1.0 + alike) / (1.0 - alike)) / float(fit.model.robot.length_m.sum())
    return float(np.clip(share, LEAST_DOUBT, MOST_DOUBT))


def _adjust(start: Fit, seen: Sequence, rows: Rows, iterations: int) -> Fit:
    model = start.model
    length = float(model.robot.length_m.sum())
    scale = 1.0 / (start.doubt * length)
    known: list[tuple[bytes, Floats, Floats]] = []

    def evaluate(x: Floats) -> tuple[Floats, Floats]:
        if not known or known[0][0] != x.tobytes():
            residual, jacobian = residuals(model, x, seen, rows)
            known[:] = [
                (
                    x.tobytes(),
                    np.concatenate([scale * residual.ravel(), x]),
                    np.vstack([scale * jacobian.reshape(-1, model.size), np.eye(model.size)]),
                )
            ]
        return known[0][1], known[0][2]

    def loss(z: Floats) -> Floats:
        # The prior's rows, the last ones, stay quadratic.
        n = len(z) - model.size
        rho = np.stack([z, np.ones_like(z), np.zeros_like(z)])
        root = np.sqrt(1.0 + z[:n])
        rho[:, :n] = 2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3
        return rho

    solution = least_squares(
        lambda x: evaluate(x)[0],
        start.x,
        jac=lambda x: evaluate(x)[1],
        loss=loss,
        f_scale=ROBUST / start.doubt,
        x_scale="jac",
        max_nfev=iterations,
        ftol=1e-4,
        xtol=1e-5,
    )
    return replace(start, x=solution.x, cost=float(solution.cost))


def residuals(model: RobotModel, x: Floats, seen: Sequence, rows: Rows) -> tuple[Floats, Floats]:
    """Errors (rows, 3 or 6) [m] of the tip (and of its orientation, scaled to a length) and their Jacobian (rows, 3 or 6,
    size) by the whitened parameters."""
    robot, values = model.robot, model.values(x)
    springs = model.springs(values)
    raised = []
    for p in range(model.size):
        stepped = x.copy()
        stepped[p] += TANGENT_STEP
        raised.append(model.values(stepped))
    others = [model.springs(other) for other in raised]
    base = springs.flat()
    moving = [p for p in range(model.size) if np.any(others[p].flat() != base)]
    bends, tangents = solve_with_tangents(
        springs, [others[p] for p in moving], seen.drive, robot.ends, slack=model.slack
    )
    bends, tangents = bends[rows], tangents[rows]
    seen_tip, seen_turn = seen.tip_m[rows], None if seen.turn is None or not model.oriented else seen.turn[rows]
    reach = TURN_LENGTH * float(robot.length_m.sum())

    def errors(v: Values, b: Floats) -> Floats:
        place, turn = poses(v, b)
        off = place - seen_tip
        if seen_turn is None:
            return off
        tilt = Rotation.from_matrix((np.swapaxes(seen_turn, -1, -2) @ turn).reshape(-1, 3, 3)).as_rotvec()
        return np.concatenate([off, reach * tilt.reshape(off.shape)], axis=-1)

    error = errors(values, bends)
    jacobian = np.zeros((*error.shape, model.size))
    n2 = bends.shape[1]
    by_bend = np.stack(
        [(errors(values, bends + BEND_STEP * np.eye(n2)[i]) - error) / BEND_STEP for i in range(n2)], axis=-1
    )
    jacobian[:, :, moving] = np.einsum("nei,npi->nep", by_bend, tangents)
    for p in range(model.size):
        if any(
            getattr(raised[p], name) is not getattr(values, name) and _differs(raised[p], values, name)
            for name in _FRAME
        ):
            jacobian[:, :, p] += (errors(raised[p], bends) - error) / TANGENT_STEP
    return error, jacobian


_FRAME = ("base_rotation", "base_position", "marker", "marker_rotation", "length")


def _differs(a: Values, b: Values, name: str) -> bool:
    return bool(np.any(getattr(a, name) != getattr(b, name)))


def begin(seen: Sequence, robot: Nominal) -> Fit:
    """A plain constant-curvature fit from many starts: where the base is, and how it and the tendons are turned.

    Raises:
        OperatorError: the tip hardly moves.
    """
    axis, top = _axis(seen)
    length = float(robot.length_m.sum())
    coarse = seen.every(max(len(seen.tip_m) // START_SAMPLES, 1))
    every_row = np.ones(len(coarse.tip_m), dtype=np.bool_)
    every = blocks(robot)
    tried = []
    for mirrored in (False, True):
        for yaw in np.arange(YAWS) * 2.0 * np.pi / YAWS:
            turn = _frame(axis) @ Rotation.from_rotvec([0.0, 0.0, yaw]).as_matrix()
            chosen = dict(every)
            chosen["base_rotation"] = every["base_rotation"]._replace(nominal=Rotation.from_matrix(turn).as_rotvec())
            chosen["base_position"] = every["base_position"]._replace(nominal=top - length * axis)
            if mirrored:
                chosen["azimuth"] = every["azimuth"]._replace(nominal=-every["azimuth"].nominal)
            model = RobotModel(robot, chosen, (), seen.turn is not None)
            tried.append(_adjust(Fit(model, np.zeros(model.size), np.inf), coarse, every_row, FIRST_LOOK))
    # Most starts show soon that they lead nowhere.
    hopeful = sorted(tried, key=lambda fit: fit.cost)[:HOPEFUL]
    best = min((_adjust(fit, coarse, every_row, SECOND_LOOK) for fit in hopeful), key=lambda fit: fit.cost)
    return adjust(best, seen)


def _axis(seen: Sequence) -> tuple[Floats, Floats]:
    """Direction of the straight robot and where its tip is: the tips lie on a dome that falls off towards the base."""
    still = np.argsort(np.linalg.norm(seen.drive.wound - np.median(seen.drive.wound, axis=0), axis=-1))
    top = np.median(seen.tip_m[still[: max(len(still) // 20, 3)]], axis=0)
    off = seen.tip_m - top
    distance = np.linalg.norm(off, axis=-1)
    near = off[distance <= np.quantile(distance, 0.5)]
    if len(near) < LEAST_MOVING_SAMPLES:
        raise OperatorError(f"{len(seen.tip_m)} samples are too few to see the base; record at least 60")
    normal = np.linalg.svd(near)[2][2]
    return (normal if np.mean(off @ normal) < 0.0 else -normal), top


def _frame(axis: Floats) -> Floats:
    """A rotation that turns z into the axis."""
    rotation, _ = Rotation.align_vectors(axis[None], np.array([[0.0, 0.0, 1.0]]))
    return np.asarray(rotation.as_matrix())
