"""SRC-Bot as a chain: its numbers, the shape of its guiders, its cables and its energies (MODEL.md 3 and 4), in NumPy.

Configuration q (..., n, 4): (b_x, b_y, ψ, L) of each segment from the base: bend vector [rad], twist of the chamber [rad],
arc length [m]. Frames: the base has +z along the straight robot.
"""

import math
from functools import cached_property
from typing import Annotated, Any

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import ArrayLike, NDArray

from cobra.kinematics.section import coefficients, rotation, translation
from cobra.mechanics.kernels.layout import Constants

Floats = NDArray[np.float64]
Positive = Annotated[float, Meta(gt=0)]
NonNegative = Annotated[float, Meta(ge=0)]

STANDARD_GRAVITY_M_S2 = 9.81
MOUNTINGS: dict[str, tuple[float, float, float]] = {
    "hanging": (0.0, 0.0, STANDARD_GRAVITY_M_S2),
    "upright": (0.0, 0.0, -STANDARD_GRAVITY_M_S2),
    "horizontal": (0.0, STANDARD_GRAVITY_M_S2, 0.0),
    "weightless": (0.0, 0.0, 0.0),
}
"""Gravity in the frame of the base [m/s²]. Horizontal: y is down, as everywhere."""
_COMPLEX_STEP = 1e-30
FOLLOW_RATE_RAD_S = 200.0
"""How fast an error in a followed motion fades: well above the bending modes, well under the rate of the steps."""


class SrcBotParameters(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True, dict=True):
    """The numbers of an SRC-Bot with n equal segments, each a chamber and the guider at its end.

    Defaults: `GIVEN` stands in the paper, everything else is assumed (MODEL.md 4).
    """

    segments: Annotated[int, Meta(ge=1, le=200)] = 5
    rest_length_m: Positive = 0.05
    """L₀ of a chamber."""
    cable_circle_diameter_m: Positive = 0.06
    """D_c."""
    cable_azimuths_deg: Annotated[tuple[float, ...], Meta(min_length=3)] = (0.0, 120.0, 240.0)
    bending_stiffness_Nm2: Positive = 0.1006
    """EI."""
    torsional_stiffness_Nm2: Positive = 0.2106
    """What the paper calls GA; its unit says that it is GJ."""
    axial_stiffness_N_m: Positive = 5136.0
    """K of one chamber."""
    guider_mass_kg: Positive = 0.08
    """With its chamber."""
    guider_inertia_bend_kgm2: Positive = 3e-5
    """J_θ."""
    guider_inertia_twist_kgm2: Positive = 5e-5
    """J_φ."""
    damping_bend_Nms: NonNegative = 0.01
    damping_twist_Nms: NonNegative = 0.01
    damping_axial_Ns_m: NonNegative = 8.0
    friction: Annotated[float, Meta(ge=0, lt=1)] = 0.1
    """η between cable and guider."""
    cable_stiffness_N_m: Positive = 3e4
    locked_length_m: Positive = 0.040
    """Of a chamber: its guiders touch."""
    unlocked_length_m: Positive = 0.042
    """Of a chamber: the slots let go."""
    lock_bend_deg: NonNegative = 2.0
    """A chamber bent more than this meets the stop without locking."""
    gravity_m_s2: tuple[float, float, float] = MOUNTINGS["hanging"]
    """In the frame of the base."""

    @cached_property
    def rest(self) -> Floats:
        """q (n, 4) of the straight robot at its natural length."""
        q = np.zeros((self.segments, 4))
        q[:, 3] = self.rest_length_m
        return q

    @cached_property
    def cable_matrix(self) -> Floats:
        """∂L_d/∂(b_x, b_y, ψ, L) (cables, 4), the same for every segment (S-8 with the errata): [−r cos β, −r sin β, 0, 1]."""
        beta = np.radians(self.cable_azimuths_deg)
        r = 0.5 * self.cable_circle_diameter_m
        return np.stack([-r * np.cos(beta), -r * np.sin(beta), np.zeros_like(beta), np.ones_like(beta)], axis=1)

    @cached_property
    def constants(self) -> Constants:
        """The same numbers for the kernels."""
        return Constants(
            bending=self.bending_stiffness_Nm2 / self.rest_length_m,
            torsion=self.torsional_stiffness_Nm2 / self.rest_length_m,
            axial=self.axial_stiffness_N_m,
            rest=self.rest_length_m,
            mass=self.guider_mass_kg,
            inertia_bend=self.guider_inertia_bend_kgm2,
            inertia_twist=self.guider_inertia_twist_kgm2,
            damping_bend=self.damping_bend_Nms,
            damping_twist=self.damping_twist_Nms,
            damping_axial=self.damping_axial_Ns_m,
            cable_stiffness=self.cable_stiffness_N_m,
            friction=self.friction,
            locked=self.locked_length_m,
            unlocked=self.unlocked_length_m,
            lock_bend=math.radians(self.lock_bend_deg),
            follow=FOLLOW_RATE_RAD_S,
            gravity_x=float(self.gravity_m_s2[0]),
            gravity_y=float(self.gravity_m_s2[1]),
            gravity_z=float(self.gravity_m_s2[2]),
        )


GIVEN = frozenset(
    {"segments", "cable_azimuths_deg", "bending_stiffness_Nm2", "torsional_stiffness_Nm2", "axial_stiffness_N_m"}
)
"""Fields of `SrcBotParameters` whose defaults the paper states; all others are assumed."""


def assumed_parameters(parameters: SrcBotParameters) -> tuple[str, ...]:
    """Fields that still have an assumed default."""
    standard = SrcBotParameters()
    return tuple(
        name
        for name in SrcBotParameters.__struct_fields__
        if name not in GIVEN and getattr(parameters, name) == getattr(standard, name)
    )


def guider_frames(q: ArrayLike) -> Floats:
    """Frames of the base and of every guider (..., n + 1, 4, 4), T_i = T_{i−1} [R(b) Rz(ψ), t; 0 1] (S-4 … S-7)."""
    return _frames(np.asarray(q, dtype=np.float64))


def backbone_frames(q: ArrayLike, pieces: int = 8) -> Floats:
    """Frames along the arcs (..., n · pieces + 1, 4, 4), `pieces` to a chamber, from the base to the top guider."""
    q = np.asarray(q, dtype=np.float64)
    share = np.linspace(0.0, 1.0, pieces, endpoint=False)
    along = _steps(q[..., None, :] * share[:, None])
    frames = guider_frames(q)
    inside = frames[..., :-1, None, :, :] @ along
    flat = inside.reshape(*q.shape[:-2], q.shape[-2] * pieces, 4, 4)
    return np.concatenate([flat, frames[..., -1:, :, :]], axis=-3)


def _frames(q: NDArray[Any]) -> NDArray[Any]:
    """As `guider_frames`, also for complex q."""
    here = _steps(q)
    out = np.empty((*q.shape[:-2], q.shape[-2] + 1, 4, 4), dtype=q.dtype)
    out[..., 0, :, :] = np.eye(4)
    for i in range(q.shape[-2]):
        out[..., i + 1, :, :] = out[..., i, :, :] @ here[..., i, :, :]
    return out


def _steps(q: NDArray[Any]) -> NDArray[Any]:
    """From guider to guider (..., 4, 4): [R(b) Rz(ψ), t; 0 1]."""
    out = np.zeros((*q.shape[:-1], 4, 4), dtype=q.dtype)
    cos, sin, one = np.cos(q[..., 2]), np.sin(q[..., 2]), np.ones_like(q[..., 2])
    zero = np.zeros_like(one)
    twist = np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], axis=-1).reshape(*q.shape[:-1], 3, 3)
    out[..., :3, :3] = rotation(q[..., :2]) @ twist
    out[..., :3, 3] = translation(q[..., :2], q[..., 3])
    out[..., 3, 3] = 1.0
    return out


def cable_lengths(parameters: SrcBotParameters, q: ArrayLike) -> Floats:
    """L_d (..., cables) [m] at q (..., n, 4): Σ_i L_i − r b_i·[cos β, sin β] (S-8)."""
    return np.asarray(q, dtype=np.float64).sum(axis=-2) @ parameters.cable_matrix.T


def cable_forces(parameters: SrcBotParameters, tensions: ArrayLike) -> Floats:
    """Generalised forces (..., 4) that tensions (..., cables) at the top guider put on every segment, −J_dᵀ F (S-34)."""
    return -np.asarray(tensions, dtype=np.float64) @ parameters.cable_matrix


def cable_tensions(parameters: SrcBotParameters, moment_Nm: ArrayLike, force_N: ArrayLike) -> Floats:
    """Tensions (..., cables) that give moments (..., 2) about the bends and a force (...,) along the robot (S-35).

    In (b_x, b_y, L) the map is constant, so nothing is singular when straight. With more than three cables the least of
    all that do it. A negative one says that a cable would have to push.
    """
    wanted = np.concatenate(
        [np.asarray(moment_Nm, dtype=np.float64), np.asarray(force_N, dtype=np.float64)[..., None]], axis=-1
    )
    return wanted @ np.linalg.pinv(-parameters.cable_matrix[:, [0, 1, 3]])


def elastic_energy(parameters: SrcBotParameters, q: ArrayLike) -> Floats:
    """Σ ½ EI |b|²/L₀ + ½ GA ψ²/L₀ + ½ K (C − C₀)² (...,) [J], with the chord C = L sin(θ/2)/(θ/2) (S-24) and C₀ that
    of the natural length at the same bend."""
    q = np.asarray(q, dtype=np.float64)
    p = parameters
    theta2 = np.sum(q[..., :2] ** 2, axis=-1)
    # (sin(θ/2)/(θ/2))² = 2 S2(θ²), so that nothing is divided by θ.
    chord2 = 2.0 * coefficients(theta2).S2 * (q[..., 3] - p.rest_length_m) ** 2
    bend = p.bending_stiffness_Nm2 * theta2 + p.torsional_stiffness_Nm2 * q[..., 2] ** 2
    return np.sum(0.5 * bend / p.rest_length_m + 0.5 * p.axial_stiffness_N_m * chord2, axis=-1)


def potential_energy(parameters: SrcBotParameters, q: ArrayLike) -> Floats:
    """U (...,) [J] of MODEL.md 4: elastic energy and weight, − Σ m g·P_i."""
    positions = guider_frames(q)[..., 1:, :3, 3]
    weight = positions @ np.asarray(parameters.gravity_m_s2) * parameters.guider_mass_kg
    return elastic_energy(parameters, q) - weight.sum(axis=-1)


def kinetic_energy(parameters: SrcBotParameters, q: ArrayLike, v: ArrayLike) -> Floats:
    """Σ ½ m |v_i|² + ½ ω_iᵀ J ω_i (...,) [J] at q̇ = v (..., n, 4), by a complex step through the guiders' frames."""
    p = parameters
    frames = _frames(np.asarray(q) + 1j * _COMPLEX_STEP * np.asarray(v))[..., 1:, :, :]
    rates = frames.imag / _COMPLEX_STEP
    spin = np.swapaxes(frames.real[..., :3, :3], -1, -2) @ rates[..., :3, :3]
    omega = np.stack([spin[..., 2, 1], spin[..., 0, 2], spin[..., 1, 0]], axis=-1)
    inertia = np.array([p.guider_inertia_bend_kgm2, p.guider_inertia_bend_kgm2, p.guider_inertia_twist_kgm2])
    twice = p.guider_mass_kg * np.sum(rates[..., :3, 3] ** 2, axis=-1) + np.sum(inertia * omega**2, axis=-1)
    return 0.5 * np.sum(twice, axis=-1)
