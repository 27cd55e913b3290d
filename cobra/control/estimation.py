"""What the motors' feedback says of tendons and backbone, with losses taken into account, and how sure that is.

Tension at the spool is the motor's load without its gear's friction: that of the motion while the drive moves; at rest it
stays what it was, as far as the friction can hold it. Where a load cell measures a tendon, that counts instead. The
tendons' model (`cobra.mechanics.rubbing`) follows the drives' travel and tells tensions on the way and bends. What it
foretells wrongly of the tensions at the spools is put down to moments from outside (a wall, a payload), found slowly.
"""

from dataclasses import dataclass

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.configuration import FEED, Floats
from cobra.mechanics.losses import Identified
from cobra.mechanics.rubbing import Rubbing
from cobra.motors.transmission import MOVING_M_S, without_gear_friction

OUTSIDE_1_S = 1.0
"""At which moments from outside are found."""
OUTSIDE_SHARE = 2.0
"""Of the moment that bends a section by a radian: no more is believed."""
HIDDEN_FROM_M = 0.02
"""Fed so far past a drive at rest, its gear's friction may hide all that walls have done to its tendon."""
DEVIATION_TICKS = 10
"""People read how sure the bends are; nothing is driven by it."""


@dataclass(frozen=True)
class TendonEstimate:
    """What is known of the m tendons now."""

    motor_N: Floats
    """(m,) tension at the spool, measured."""
    expected_N: Floats
    """(m,) what the model expects there for the drives' travel."""
    profile_N: Floats
    """(m, n + 2) tension at motor, port and end of each section; NaN beyond the tendon's end."""
    bends: Floats
    """(c,) entries of q that the tendons decide."""
    deviation: Floats
    """(c,) their standard deviation."""
    residual_m: Floats
    """(m,) length that no shape explains: what is felt beyond what is expected, over the tendon's stiffness."""
    spool_m: Floats
    """(m,) where the spools stand, behind the play of their gears; paying out counts positive."""
    pressed: float
    """The largest moment from outside, as a share of what is believed at most: at 1 it may be larger."""


class Estimator:
    """Follows the feedback tick by tick; what rubs remembers where it came from."""

    def __init__(self, description: RobotDescription, model: Rubbing, identified: Identified) -> None:
        self._model = model
        self._losses = identified.losses
        self._deviation = identified.deviation
        self._index = np.array(description.tendon_drives, dtype=np.int64)
        m = len(self._index)
        self._motor = np.zeros(m)
        self.spool_m = np.zeros(m)
        """(m,) where the spools stand, behind the play of their gears."""
        self.outside_Nm = np.zeros(len(model.columns))
        """(c,) moments from outside."""
        sections = self._losses.bending_stiffness_Nm2[model.column_section] / model.lengths_m[model.column_section]
        self._most_Nm = OUTSIDE_SHARE * sections
        self._squares = np.linalg.pinv(model.slopes) ** 2
        self._start()

    def _start(self) -> None:
        self._feed_m = np.nan
        self._fed_m = np.zeros(len(self._index))  # since the tendon's drive moved
        self._deviation_of_bends = np.zeros(len(self._model.columns))
        self._ticks = 0

    def refer(self, travel: Floats, load: Floats, measured: Floats) -> None:
        """This is the straight robot, homed: its bends are 0 from here."""
        drawn_in = load[self._index] - self._losses.drive_friction_N
        self._motor = np.maximum(np.where(np.isnan(measured), drawn_in, measured), 0.0)
        # Homing ends drawing in.
        self.spool_m = travel[self._index] + self._losses.backlash_m / 2
        self.outside_Nm[:] = 0.0
        self._model.reset(self._motor)
        self._start()

    def observe(
        self, travel: Floats, velocity: Floats, load: Floats, measured: Floats, q: Floats, dt_s: float
    ) -> TendonEstimate:
        """One tick: travel, velocity and load of all drives, tensions that load cells measure (m,) [N] or NaN, and q for
        twist and feed."""
        losses, model = self._losses, self._model
        speed = velocity[self._index]
        felt = without_gear_friction(self._motor, load[self._index], speed, losses.drive_friction_N)
        motor = np.maximum(np.where(np.isnan(measured), felt, measured), 0.0)
        shaft = travel[self._index]
        spool = np.clip(self.spool_m, shaft - losses.backlash_m / 2, shaft + losses.backlash_m / 2)
        model.advance(spool - self.spool_m, q, self.outside_Nm, dt_s)
        self._motor, self.spool_m = motor, spool
        beyond = motor - model.motor_N
        moments = -model.slopes.T @ beyond
        outside = self.outside_Nm - OUTSIDE_1_S * dt_s * moments
        self.outside_Nm = np.clip(outside, -self._most_Nm, self._most_Nm)
        profile = model.profile_N
        profile[:, 0] = motor
        fed = 0.0 if np.isnan(self._feed_m) else abs(q[FEED] - self._feed_m)
        self._feed_m = q[FEED]
        self._fed_m = np.where((np.abs(speed) > MOVING_M_S) | ~np.isnan(measured), 0.0, self._fed_m + fed)
        if self._ticks % DEVIATION_TICKS == 0:
            self._deviation_of_bends = self._uncertainty(beyond, profile)
        self._ticks += 1
        return TendonEstimate(
            motor_N=motor,
            expected_N=model.motor_N,
            profile_N=profile,
            bends=model.bends.copy(),
            deviation=self._deviation_of_bends,
            residual_m=beyond / model.stiffness_N_m,
            spool_m=spool,
            pressed=float(np.max(np.abs(self.outside_Nm) / self._most_Nm, initial=0.0)),
        )

    def _uncertainty(self, beyond: Floats, profile: Floats) -> Floats:
        """Of the bends: from stiffness and radius, which scale, and from friction and what the model does not explain."""
        losses, deviation, model = self._losses, self._deviation, self._model
        scale = deviation.axial_stiffness_N / losses.axial_stiffness_N
        stretch = (profile[:, 0] - profile[:, 0].mean()) / model.stiffness_N_m
        hidden = losses.drive_friction_N * np.minimum(self._fed_m / HIDDEN_FROM_M, 1.0)
        rubbing = np.hypot(deviation.drive_friction_N, profile[:, 1] * deviation.conduit_capstan)
        unknown = np.hypot(np.hypot(rubbing, beyond), hidden)
        lengths = np.stack([stretch * scale, unknown / model.stiffness_N_m, deviation.backlash_m / 2])
        variance = self._squares @ (lengths**2).sum(axis=0)
        radius = deviation.radius_m / np.maximum(losses.radius_m, 1e-9)
        out: Floats = np.sqrt(variance + (model.bends * radius[model.column_section]) ** 2)
        return out
