"""A robot's tendons with stretch and friction, and the shape that is in balance with them; quasi-static, with memory.

Each tendon is a row of elastic elements, the conduit's and one in each section, between which it slides only at the edge
of a friction cone (capstan, E6, in both directions: the tension anywhere on its way depends on the past of both ends).
Sections are arcs; their bends b minimise what the tendons, the elasticity and the weight leave of moments,

    -Σ_j ∂Δl_j/∂b T_j − K b − ∂U_g/∂b + M = D ḃ        K = EI/ℓ_e, D = K τ, M from outside

Moved by the motor ends of the tendons it tells bends and tensions (`advance`); asked for bends it tells where the motor
ends must go (`reach`). The same model serves estimation, compensation and identification.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.compiled import CompiledKinematics
from cobra.kinematics.configuration import FEED, Configuration, Floats
from cobra.kinematics.tendons import TendonMap
from cobra.mechanics import rubbing_kernels as kernels
from cobra.mechanics.losses import Losses

CONDUIT_NODES = 6
"""At which the conduit's friction is gathered."""
LEAST_CONDUIT_M = 0.1
"""A robot without conduit still has a little cable between spool and port."""
POINTS = 16
"""Along the active segment, at which its weight acts."""
LEAST_EXPOSED = 0.05
"""Of a section: what is shorter outside the port bends as stiffly."""


class Rubbing:
    """m tendons over n sections with given losses; c columns of q that the tendons decide."""

    def __init__(self, description: RobotDescription, losses: Losses) -> None:
        self.losses = losses
        robot = losses.applied(description)
        self.tendons = TendonMap(robot)
        self.columns: NDArray[np.int64] = np.array(self.tendons.columns, dtype=np.int64)
        self.slopes = np.ascontiguousarray(self.tendons.matrix[:, self.columns])
        """(m, c) ∂Δl/∂b [m/rad]"""
        self.column_section: NDArray[np.int64] = np.array(
            [k for k in robot.active_sections for _ in range(2)], dtype=np.int64
        )
        self.section_of: NDArray[np.int64] = np.array(robot.tendon_section, dtype=np.int64)
        self.lengths_m = np.array([section.length_m for section in robot.sections])
        self._conduit_m = max(robot.tendon.conduit_length_m if robot.tendon else 0.0, LEAST_CONDUIT_M)
        self._parts = CONDUIT_NODES + 1
        self._counts = self._parts + 1 + self.section_of
        kinematics = CompiledKinematics(robot)
        self._active_m = robot.active_length_m
        arc = np.linspace(0.0, self._active_m, POINTS)
        weights = np.full(POINTS, self._active_m / (POINTS - 1))
        weights[[0, -1]] /= 2.0
        gravity = np.array(robot.backbone.gravity_m_s2)
        force = robot.backbone.mass_per_length_kg_m * weights[:, None] * gravity
        self._body = (kinematics.layout, kinematics.lengths_m, self._active_m, arc, force)
        self._rest = Configuration(robot).rest()
        lengths = np.zeros((len(self.slopes), self._parts + len(self.lengths_m)))
        share = np.full(self._parts, 1.0 / CONDUIT_NODES)
        share[[0, -1]] /= 2.0
        lengths[:, : self._parts] = self._conduit_m * share
        lengths[:, self._parts :] = self.lengths_m
        self._element = losses.axial_stiffness_N / lengths
        self._capstan = np.ones((lengths.shape[0], lengths.shape[1] - 1))
        self._capstan[:, :CONDUIT_NODES] = np.exp(losses.conduit_capstan / CONDUIT_NODES)
        own = np.arange(lengths.shape[1]) < self._counts[:, None]
        self.stiffness_N_m = losses.axial_stiffness_N / np.where(own, lengths, 0.0).sum(axis=1)
        """(m,) of each tendon over conduit and path"""
        answer = self.slopes.T @ (self.stiffness_N_m[:, None] * self.slopes)
        self._inverse = np.linalg.inv(answer) if len(answer) else answer
        self._dithered = bool(robot.tendon and robot.tendon.dither_cycles)
        self.reset(np.zeros(len(self.slopes)))

    def reset(self, motor_N: Floats) -> None:
        """Straight, at these tensions (m,) at the motors, as homing leaves it: everything drawn in last.

        Where it has pulled to and fro, the far end keeps what is left of that, the mean along the tendon.
        """
        along = np.cumprod(np.concatenate([np.ones((len(motor_N), 1)), 1.0 / self._capstan], axis=1), axis=1)
        own = np.arange(along.shape[1]) < self._counts[:, None]
        if self._dithered:
            share = np.where(own, 1.0 / self._element, 0.0)
            along = np.maximum(along, np.sum(along * share, axis=1, keepdims=True) / share.sum(axis=1, keepdims=True))
        self._state = np.where(own, motor_N[:, None] * along / self._element, 0.0)
        self.bends = np.zeros(len(self.columns))
        """(c,) in balance"""
        self._tension = self._state * self._element
        self._guess = np.zeros(along.shape, dtype=np.int64)

    @property
    def motor_N(self) -> Floats:
        """(m,) tension at the spools."""
        return self._tension[:, 0].copy()

    @property
    def conduits(self) -> tuple[Floats, Floats, Floats]:
        """Of the elements between motor and port: extension (m, P) [m], stiffness (m, P) [N/m], and the ratio of tensions
        at which they slide (m, P − 1)."""
        parts = self._parts
        return self._state[:, :parts], self._element[:, :parts], self._capstan[:, : parts - 1]

    @property
    def profile_N(self) -> Floats:
        """(m, n + 2) tension at motor, port and the end of each section; NaN beyond the tendon's end."""
        parts = self._parts
        middle = self._tension[:, parts:]
        following = np.concatenate([middle[:, 1:], middle[:, -1:]], axis=1)
        last = np.arange(middle.shape[1]) == self.section_of[:, None]
        ends = np.where(last, middle, np.sqrt(middle * following))
        ends[np.arange(middle.shape[1]) > self.section_of[:, None]] = np.nan
        return np.concatenate([self._tension[:, :1], self._tension[:, parts - 1 : parts], ends], axis=1)

    def warm_up(self) -> None:
        """Compile (seconds the first time on a machine, then from the cache). Ends as `reset` without tension."""
        nothing = np.zeros(len(self.slopes))
        at_rest = np.zeros(len(self.columns))
        self.advance(nothing, self._rest, at_rest, 1.0)
        self.reach(self._rest, np.zeros_like(self._rest), nothing, at_rest, np.stack([at_rest, at_rest]))
        self.reset(nothing)

    def advance(self, paid_out: Floats, q: Floats, outside: Floats, dt_s: float) -> None:
        """The motor ends have paid out (m,) [m] within `dt_s`; q (size,) tells twist and feed, `outside` (c,) M [N·m]."""
        robot = self._robot(q)
        drag = self.losses.settling_s * robot[2] / dt_s
        room = self._room()
        kernels.advance(
            self._state, self.bends, paid_out, robot, self.losses.hole_friction, self._weight(q) - outside, drag, room
        )
        self._tension, self._guess = room[2], room[3]

    def reach(self, q: Floats, velocity: Floats, paid_out: Floats, outside: Floats, tolerance: Floats) -> Floats:
        """(c,) s: the motor ends must pay out `paid_out` + slopes · s from where they are, so that q is in balance.

        `velocity` (size,) is that of q; bends will do that are below it by up to
        tolerance[0] (c,) [rad] or above by up to tolerance[1].
        """
        robot = self._robot(q)
        drag = self.losses.settling_s * robot[2][self.column_section] * velocity[self.columns]
        goal = np.ascontiguousarray((q - self._rest)[self.columns])
        out = np.zeros(len(self.columns))
        kernels.reach(
            self._state,
            self.bends,
            goal,
            paid_out,
            robot,
            self.losses.hole_friction,
            self._weight(q, goal) + drag - outside,
            self._room(),
            self._inverse,
            tolerance,
            out,
        )
        return out

    def follow(self, shafts: Floats, others: Floats, play_m: Floats, dt_s: float) -> tuple[Floats, Floats]:
        """Motor tensions (N, m) and bends (N, c) while the shafts go (N, m) [m], even steps of `dt_s`, from `reset` on.

        `others` (N, size) tell twist and feed, which must not change.
        """
        robot = self._robot(others[0])
        q = others[0].copy()
        q[self.columns] = self.bends
        # Homing ends drawing in.
        end = shafts[0] + play_m / 2
        tensions, bends = kernels.march(
            self._state,
            q,
            np.ascontiguousarray(shafts),
            np.ascontiguousarray(others),
            end,
            play_m / 2,
            self.columns,
            robot,
            self.losses.hole_friction,
            self.losses.settling_s * robot[2] / dt_s,
            self._room(),
            self._body,
        )
        return tensions, bends

    def _weight(self, q: Floats, bends: Floats | None = None) -> Floats:
        own = np.array(q, dtype=np.float64)
        own[self.columns] = self.bends if bends is None else bends
        out: Floats = kernels.weight_moments(own, self.columns, *self._body)
        return out

    def _robot(self, q: Floats) -> tuple[Any, ...]:
        starts = np.cumsum(self.lengths_m) - self.lengths_m
        inside = np.clip(self._active_m - q[FEED] - starts, 0.0, (1.0 - LEAST_EXPOSED) * self.lengths_m)
        bending = self.losses.bending_stiffness_Nm2 / (self.lengths_m - inside)
        return self.slopes, self.column_section, bending, self._element, self._counts, self._parts

    def _room(self) -> tuple[Any, ...]:
        return np.zeros_like(self._state), self._capstan.copy(), np.zeros_like(self._state), self._guess.copy()
