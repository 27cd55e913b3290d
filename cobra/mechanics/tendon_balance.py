"""Statics of a tendon-driven robot with friction: which tensions hold a shape, and how far they stretch the tendons.

Sections are arcs; moments on them are conjugate to the bend vectors. Tendon j, of tension T_jk in section k, gives

    Σ_j r_j T_jk e_j = K_k(ℓ_e) b_k + ∂U_g/∂b_k          K_k = EI/ℓ_e, U_g the weight's potential

Along its way the tension falls by friction (capstan, E6): from motor to port by exp(−σ_c μΘ), in a section by
exp(−σ μ θ), σ ∈ [−1, 1] the direction in which the tendon slides there (+1 towards the motor). Between motor and port it
is stretched by T_port (e^{σ a} − 1)/(σ a) · ℓ/EA, a = μΘ.
"""

from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics import kernels
from cobra.kinematics.compiled import CompiledKinematics
from cobra.kinematics.configuration import Configuration, Floats
from cobra.kinematics.tendons import TendonMap
from cobra.mechanics.losses import Losses

POINTS = 31
"""Along the active segment, at which its weight acts."""
STEP_RAD = 1e-5


class Stretch(NamedTuple):
    """What holds a shape."""

    motor_N: Floats
    """(m,) tension at the spools."""
    stretch_m: Floats
    """(m,) of each tendon, unstretched length taken off."""


class TendonBalance:
    """The statics of one robot with given losses; n sections, m tendons, c columns of q that the tendons decide."""

    def __init__(self, description: RobotDescription, losses: Losses) -> None:
        self.losses = losses
        robot = losses.applied(description)
        self.description = robot
        self.configuration = Configuration(robot)
        self.tendons = TendonMap(robot)
        self.slopes = self.tendons.matrix[:, self.tendons.columns].copy()
        """(m, c) ∂Δl/∂q of the columns [m/rad, 1]."""
        self.inverse = np.linalg.pinv(self.slopes)
        self.section_of = np.array(robot.tendon_section, dtype=np.int64)
        n = len(robot.sections)
        self._passes = np.arange(n)[None, :] <= self.section_of[:, None]
        self.section_lengths_m = np.array([section.length_m for section in robot.sections])
        self.conduit_m = robot.tendon.conduit_length_m if robot.tendon else 0.0
        kinematics = CompiledKinematics(robot)
        self._layout, self._section_lengths = kinematics.layout, kinematics.lengths_m
        self._arc = np.linspace(0.0, robot.active_length_m, POINTS)
        weights = np.full(POINTS, robot.active_length_m / (POINTS - 1))
        weights[[0, -1]] /= 2.0
        gravity = np.array(robot.backbone.gravity_m_s2)
        self._weight = robot.backbone.mass_per_length_kg_m * weights[:, None] * gravity
        self.column_section = np.array(
            [k for k in robot.active_sections for _ in range(2)] if not any(self.configuration.lengths) else [],
            dtype=int,
        )

    @property
    def stiffness_N_m(self) -> Floats:
        """(m,) k of each tendon over conduit and path."""
        return self.losses.axial_stiffness_N / self._lengths_m()

    def _lengths_m(self) -> Floats:
        return self.conduit_m + np.where(self._passes, self.section_lengths_m, 0.0).sum(axis=1)

    def bend_angles(self, q: Floats) -> Floats:
        """(n,) |b_k| [rad]."""
        return np.array([np.hypot(*q[where]) for where in self.configuration.bends])

    def moments(self, q: Floats) -> Floats:
        """(c,) what the tendons must give at q: elastic and the weight's."""
        exposed = self._exposed(q)
        columns = self.tendons.columns
        stiffness = self.losses.bending_stiffness_Nm2 / np.maximum(exposed, 1e-3)
        return stiffness[self.column_section] * q[columns] + self._weight_moments(q)

    def _weight_moments(self, q: Floats) -> Floats:
        own = np.array(q, dtype=np.float64)
        out = np.zeros(len(self.tendons.columns))
        base = self._potential(own)
        for i, column in enumerate(self.tendons.columns):
            own[column] += STEP_RAD
            out[i] = (self._potential(own) - base) / STEP_RAD
            own[column] -= STEP_RAD
        return out

    def _potential(self, q: Floats) -> float:
        points = kernels.positions_at(q, self._layout, self._section_lengths, float(self._arc[-1]), self._arc)
        return -float(np.sum(points * self._weight))

    def _exposed(self, q: Floats) -> Floats:
        starts = np.cumsum(self.section_lengths_m) - self.section_lengths_m
        inside = np.clip(self._arc[-1] - q[1] - starts, 0.0, self.section_lengths_m)
        return self.section_lengths_m - inside

    def hole_ratios(self, q: Floats, slides: Floats) -> tuple[Floats, Floats]:
        """(m, n) tension in the middle and at the end of each section over that at the port; `slides` (m, n) σ."""
        loss = slides * self.losses.hole_friction * self.bend_angles(q)
        along = np.cumsum(loss, axis=1)
        return np.exp(-(along - loss / 2)), np.exp(-along)

    def effect(self, middle: Floats) -> Floats:
        """(c, m) moments per tension at the port: −∂Δl/∂b with each section's friction."""
        return -(self.slopes * middle[:, self.column_section]).T

    def stretch_of(self, port_N: Floats, conduit_slides: Floats, middle: Floats) -> Floats:
        """(m,) stretch [m] for tensions at the port."""
        a = conduit_slides * self.losses.conduit_capstan
        mean = np.where(np.abs(a) > 1e-6, np.expm1(a) / np.where(np.abs(a) > 1e-6, a, 1.0), 1.0)
        along = self.conduit_m * mean + np.where(self._passes, self.section_lengths_m * middle, 0.0).sum(axis=1)
        return port_N * along / self.losses.axial_stiffness_N

    def holding(
        self, q: Floats, port_level_N: Floats, conduit_slides: Floats, slides: Floats
    ) -> tuple[Floats, Stretch]:
        """Tensions at the port (m,) that hold q, nearest to `port_level_N` (m,), and what they are at the motor."""
        middle, _ = self.hole_ratios(q, slides)
        effect = self.effect(middle)
        port = port_level_N + np.linalg.pinv(effect) @ (self.moments(q) - effect @ port_level_N)
        motor = port * np.exp(conduit_slides * self.losses.conduit_capstan)
        return port, Stretch(motor, self.stretch_of(port, conduit_slides, middle))
