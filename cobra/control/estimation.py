"""What the motors' feedback says of tendons and backbone, with losses taken into account, and how sure that is.

Tension at the spool is what a load cell measures there, or else the motor's load without its gear's friction: that of the
motion while the drive moves; at rest it stays what it was, as far as the friction can hold it. Behind it the tendon holds by friction anywhere within the capstan's cone, and keeps its tension until it must slide: so each place of
the profile is the last value, clipped to the cone around the place before. Stretch follows from the profile, the tendons'
lengths at the port from travel and stretch, the bends from those by least squares.
"""

from dataclasses import dataclass

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.tendon_balance import TendonBalance

MOVING_M_S = 5e-5
"""Slower than this a drive may stand."""

CONDUIT_PARTS = 6
"""On a reversal friction lets go from the motor on: so many parts do so one after the other."""


@dataclass(frozen=True)
class TendonEstimate:
    """What is known of the m tendons now."""

    motor_N: Floats
    """(m,) tension at the spool."""
    profile_N: Floats
    """(m, n + 2) tension at motor, port and end of each section; NaN beyond the tendon's end."""
    length_m: Floats
    """(m,) change of length at the port: travel, play and stretch."""
    bends: Floats
    """(c,) entries of q that the tendons decide."""
    deviation: Floats
    """(c,) their standard deviation."""
    residual_m: Floats
    """(m,) what no shape explains."""


class Estimator:
    """Follows the feedback tick by tick; what rubs remembers where it came from."""

    def __init__(self, description: RobotDescription, balance: TendonBalance, identified: Identified) -> None:
        self._balance = balance
        self._losses = identified.losses
        self._deviation = identified.deviation
        self._index = np.array(description.tendon_drives, dtype=np.int64)
        m, n = len(self._index), len(description.sections)
        passes = np.arange(n)[None, :] <= balance.section_of[:, None]
        self._exists = np.concatenate([np.ones((m, 2), dtype=np.bool_), passes], axis=1)
        self._places = np.array([0, *range(CONDUIT_PARTS, CONDUIT_PARTS + n + 1)])
        conduit = np.full((m, CONDUIT_PARTS), balance.conduit_m / CONDUIT_PARTS)
        self._carried_m = np.concatenate([conduit, np.where(passes, balance.section_lengths_m, 0.0)], axis=1)
        self._motor: Floats | None = None
        self._tension: Floats | None = None
        self._zero_m = np.zeros(m)
        self._spool = np.zeros(m)

    def refer(self, travel: Floats, load: Floats, measured: Floats) -> None:
        """This is the straight robot, homed: its tendons' lengths are 0 from here."""
        self._motor = load[self._index] - self._losses.drive_friction_N
        self._spool = travel[self._index].copy()
        self._tension = None
        self._zero_m = np.zeros(len(self._index))
        estimate = self.observe(travel, np.zeros_like(travel), load, measured, self._balance.configuration.rest())
        self._zero_m = estimate.length_m

    def observe(self, travel: Floats, velocity: Floats, load: Floats, measured: Floats, q: Floats) -> TendonEstimate:
        """One tick: travel, velocity and load of all drives, tensions that load cells measure (m,) [N] or NaN, and about
        which q the tendons rub."""
        losses, balance = self._losses, self._balance
        speed = velocity[self._index]
        reading, rubs = load[self._index], losses.drive_friction_N
        held = reading if self._motor is None else np.clip(self._motor, reading - rubs, reading + rubs)
        felt = np.where(np.abs(speed) > MOVING_M_S, reading + rubs * np.sign(speed), held)
        motor = np.maximum(np.where(np.isnan(measured), felt, measured), 0.0)
        self._motor = motor
        # The play of the gear: the spool follows the shaft within ± half of it.
        shaft = travel[self._index]
        half = losses.backlash_m / 2
        self._spool = np.clip(self._spool, shaft - half, shaft + half)
        tension = self._follow(motor, balance.bend_angles(q))
        stretch = self._stretch(tension)
        profile = np.where(self._exists, tension[:, self._places], np.nan)
        length = self._spool + stretch - self._zero_m
        bends = balance.inverse @ length
        return TendonEstimate(
            motor_N=motor,
            profile_N=profile,
            length_m=length,
            bends=bends,
            deviation=self._uncertainty(bends, stretch, profile),
            residual_m=length - balance.slopes @ bends,
        )

    def _follow(self, motor: Floats, angles: Floats) -> Floats:
        """Tensions (m, CONDUIT_PARTS + 1 + n): at the ends of the conduit's parts and of the sections, motor first."""
        parts = np.full(CONDUIT_PARTS, self._losses.conduit_capstan / CONDUIT_PARTS)
        ratios = np.exp(np.concatenate([parts, self._losses.hole_friction * angles]))
        last = self._tension
        out = np.empty((len(motor), len(ratios) + 1))
        out[:, 0] = motor
        for i, ratio in enumerate(ratios):
            before = out[:, i]
            # At first: as homing leaves it, drawn in.
            known = before / ratio if last is None else last[:, i + 1]
            out[:, i + 1] = np.minimum(np.maximum(known, before / ratio), before * ratio)
        self._tension = out
        return out

    def _stretch(self, tension: Floats) -> Floats:
        means = (tension[:, :-1] + tension[:, 1:]) / 2
        return (means * self._carried_m).sum(axis=1) / self._losses.axial_stiffness_N

    def _uncertainty(self, bends: Floats, stretch: Floats, profile: Floats) -> Floats:
        """Of the bends: from stiffness and radius, which scale, and from friction, which may stand anywhere in its cone."""
        losses, deviation, balance = self._losses, self._deviation, self._balance
        scale = deviation.axial_stiffness_N / losses.axial_stiffness_N
        compliance = 1.0 / balance.stiffness_N_m
        rubbing = np.hypot(deviation.drive_friction_N, profile[:, 1] * deviation.conduit_capstan)
        lengths = np.stack([(stretch - stretch.mean()) * scale, rubbing * compliance, deviation.backlash_m / 2])
        variance = (balance.inverse**2) @ (lengths**2).sum(axis=0)
        radius = deviation.radius_m / np.maximum(losses.radius_m, 1e-9)
        return np.sqrt(variance + (bends * radius[balance.column_section]) ** 2)
