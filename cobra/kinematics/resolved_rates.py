"""Resolved rates: from a wanted velocity of the tip to the rates of q, inside every limit (MODEL 5).

A bounded least-squares problem a tick. With y the rates in shares of what each may, ê the wanted tip velocity scaled to
length one, and s ∈ [0, 1] how much of it is given:

    min ½|Ĵy − s ê|² + ½ w_s (1 − s)² + ½ λ²|y|² + ½ γ|N(y − y_c)|²

w_s ≪ 1: what cannot be had slows and stops along its direction. λ damps near singularities. N is the null space of Ĵ,
in which y_c draws the bends towards straight. The constraints are those of `rate_limits.py`.
"""

import math
from typing import Literal, NamedTuple

import daqp
import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone, in_tip_frame
from cobra.kinematics.compiled import CompiledKinematics
from cobra.kinematics.configuration import Configuration, Floats
from cobra.kinematics.ramps import reached, shortened
from cobra.kinematics.rate_limits import Bounds, RateLimits
from cobra.kinematics.tendons import TendonMap

DIRECTION = 0.003
"""w_s: giving less of the command is this much cheaper than leaving its direction."""
CENTRING = 0.001
"""γ"""
CENTRING_SPEED = 0.5
"""y_c of a section bent to its limit, for a command of full size."""
SINGULAR_BELOW = 0.08
"""Damping begins where the least singular value of Ĵ is under so much of the largest."""
DAMPING_MAX = 0.05
"""λ at a singularity, in shares of the largest singular value."""
_SOLVED = (1, 2)
"""daqp's exit flags: optimal, and optimal with soft constraints that give way."""
_SOFT = 8
"""daqp's sense of a soft constraint."""

Solver = Literal["qp", "damped least squares", "braking"]


class RateStep(NamedTuple):
    """One tick of resolved rates."""

    q: Floats
    """(size,) the next configuration."""
    velocity: Floats
    """(size,) from here to there, per second."""
    scale: float
    """The share of the command that is given; under 1 something binds."""
    damping: float
    """λ²"""
    solver: Solver
    """Damped least squares steps in when the solver fails; braking is for a command of zero."""
    binding: tuple[str, ...]
    """What keeps the command from being given, in words."""


class TipWeights(NamedTuple):
    """How much each component of the tip's velocity counts [s/m, s/rad]; 0 leaves it free."""

    linear: tuple[float, float, float]
    """Right, down, forward in the tip camera's frame."""
    angular: tuple[float, float, float]
    """About right, down and forward; the last is the roll of the picture."""


def tip_speed_m_s(description: RobotDescription) -> float:
    """Speed of the tip under a full stick."""
    teleop = description.teleop
    return teleop.tip.speed_m_s or 0.5 * math.radians(teleop.bend_rate_deg_s) * description.active_length_m


def default_weights(description: RobotDescription) -> TipWeights:
    """From the described rates and shares: by default the tip's place counts, and its roll where a drive twists."""
    tip, twist = description.teleop.tip, description.twist
    speed, turning = (
        tip_speed_m_s(description),
        math.radians(twist.rate_deg_s if twist else description.teleop.bend_rate_deg_s),
    )
    right, down, ahead = (weight / speed for weight in tip.place_weights)
    shares = tip.view_weights or (0.0, 0.0, 1.0 if twist else 0.0)
    about_right, about_down, roll = (weight / turning for weight in shares)
    return TipWeights((right, down, ahead), (about_right, about_down, roll))


class ResolvedRates:
    """Resolved rates of one robot."""

    def __init__(self, description: RobotDescription, weights: TipWeights | None = None) -> None:
        self.configuration = layout = Configuration(description)
        self.limits = RateLimits(description)
        self.fallbacks = 0
        """How often the solver failed and damped least squares stepped in."""
        chosen = weights or default_weights(description)
        self._weights = np.array([*chosen.linear, *chosen.angular])
        self._kinematics = CompiledKinematics(description, count=2)
        self._backbone = Backbone(description)
        self._tendons = TendonMap(description)
        self._moves = self.limits.moves
        self._rate = layout.rate[self._moves]
        self._bends = tuple((i, layout.bends[i]) for i in description.active_sections)
        most = np.full(layout.size, np.inf)
        for i, where in self._bends:
            most[where] = description.sections[i].max_bend_rad
        self._most = most[self._moves]

    def warm_up(self) -> None:
        """Compile now, and not while driving."""
        self._kinematics.warm_up()

    def step(self, q: Floats, velocity: Floats, tip_velocity: Floats, dt_s: float) -> RateStep:
        """The step of one tick towards a tip velocity.

        Args:
            q: configuration (size,).
            velocity: rates of q of the last tick (size,).
            tip_velocity: wanted, in the tip camera's frame (6,): linear [m/s], angular [rad/s].
            dt_s: duration of the tick.
        """
        bounds = self.limits.bounds(q, velocity, dt_s)
        wanted = self._weights * tip_velocity
        size = float(np.linalg.norm(wanted))
        if size == 0.0:
            return RateStep(*self._taken(q, bounds.braking, bounds, dt_s), 1.0, 0.0, "braking", ())
        counts = self._weights > 0.0
        tick = self._kinematics(q)
        jacobian = in_tip_frame(tick.tip, tick.jacobian)[:, self._moves]
        J, e = (self._weights[:, None] * jacobian * self._rate)[counts], wanted[counts] / size
        _, values, Vt = np.linalg.svd(J)
        damping = _damping(values)
        scale = self._rate * size
        centre = -CENTRING_SPEED * q[self._moves] / self._most
        solver: Solver = "qp"
        y, share = _solve(J, e, damping, _null_space(values, Vt, damping), centre, scale, bounds)
        if y is None:
            self.fallbacks += 1
            solver = "damped least squares"
            y = J.T @ np.linalg.solve(J @ J.T + (damping + 1e-9 * values[0] ** 2) * np.eye(len(e)), e)
        kept = bounds.share(y * scale)
        rates = bounds.braking + kept * (y * scale - bounds.braking)
        share = kept if solver == "damped least squares" else share
        next_q, next_velocity = self._taken(q, rates, bounds, dt_s)
        return RateStep(next_q, next_velocity, share, damping, solver, self._binding(next_q, share, damping))

    def _taken(self, q: Floats, rates: Floats, bounds: Bounds, dt_s: float) -> tuple[Floats, Floats]:
        """q after the rates, every limit of place kept whatever they are; and the rates that it took."""
        now = self._tendons.lengths(q)
        low, high = np.minimum(self.limits.tendon_low, now), np.maximum(self.limits.tendon_high, now)
        for share in (1.0, 0.5, 0.25, 0.0):
            there = q.copy()
            there[self._moves] += (bounds.braking + share * (rates - bounds.braking)) * dt_s
            there = np.clip(there, np.minimum(self.limits.low, q), np.maximum(self.limits.high, q))
            limits = self._backbone.bend_limits(there)
            for i, where in self._bends:
                # What slides into the port is straightened there; the rest of the rate is for the bend's own motion.
                inside = shortened(q[where], float(limits[i]))
                end = shortened(there[where], float(limits[i]))
                there[where] = reached(inside, end, q[where], self.configuration.rate[where.start] * dt_s)
            lengths = self._tendons.lengths(there)
            if np.all(lengths >= low - 1e-12) and np.all(lengths <= high + 1e-12):
                return there, (there - q) / dt_s
        return q.copy(), np.zeros_like(q)

    def _binding(self, q: Floats, share: float, damping: float) -> tuple[str, ...]:
        if share > 0.99:
            return ()
        singular = ("the shape is near a singular one, where the tip cannot move that way",) if damping else ()
        return (*self.limits.words(q), *singular) or ("the drives are as fast as they may be",)


def _damping(values: Floats) -> float:
    """λ² = λ_max² (1 − (σ_min/ε)²) for σ_min < ε, else 0 (Nakamura and Hanafusa; Chiaverini)."""
    ratio = values[-1] / (SINGULAR_BELOW * values[0])
    return float((DAMPING_MAX * values[0]) ** 2 * max(1.0 - ratio * ratio, 0.0))


def _null_space(values: Floats, Vt: Floats, damping: float) -> Floats:
    """Projector on what does not move the tip (m, m); damped directions count as moving it."""
    share = np.ones(len(Vt))
    share[: len(values)] = (damping + 1e-12) / (values**2 + damping + 1e-12)
    return (Vt.T * share) @ Vt


def _solve(
    J: Floats, e: Floats, damping: float, null: Floats, centre: Floats, scale: Floats, bounds: Bounds
) -> tuple[Floats | None, float]:
    """The quadratic program over (y, s) (module's docstring): y and s, or None when the solver found no optimum."""
    m, k = len(scale), len(bounds.rows)
    M = np.column_stack([J, -e])
    H = M.T @ M
    H[:m, :m] += damping * np.eye(m) + CENTRING * (null.T @ null)
    H[np.diag_indices(m + 1)] += 1e-8
    H[m, m] += DIRECTION
    f = np.append(-CENTRING * (null.T @ (null @ centre)), -DIRECTION)
    A = np.zeros((k, m + 1))
    A[:, :m] = bounds.rows * scale
    low = np.concatenate([bounds.low[:m] / scale, [0.0], bounds.low[m:]])
    high = np.concatenate([bounds.high[:m] / scale, [1.0], bounds.high[m:]])
    sense = np.zeros(m + 1 + k, dtype=np.intc)
    sense[m + 1 + bounds.places :] = _SOFT
    x, _, flag, _ = daqp.solve(H, f, A, high, low, sense)
    if flag not in _SOLVED or not np.all(np.isfinite(x)):
        return None, 0.0
    return np.asarray(x[:m]), float(x[m])
