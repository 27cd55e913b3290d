"""Pull the sections together until their guiders touch, take that as the reference, and let go again (MODEL 3, 4).

Against the stop a tendon's force rises with its own stiffness, a hundred times that of the chambers: a newton of friction
or of resolution is then worth hundredths of a millimetre, where at pretension it would be worth degrees of bend.
"""

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.kinematics.tendons import TendonMap

Floats = NDArray[np.float64]

SPEED_M_S = 0.010
CAREFUL_M_S = 0.002
CAREFUL_FROM = 0.75
"""Of the wanted tension."""
HOLD_S = 0.1
RELEASE_M_S = 0.012
LARGEST_PULL = 0.9
"""Of the maximum tension: what is pulled at most."""
EXTRA_M = 0.010
"""Wound in beyond the chambers' stroke at most, for stretch and for what the chambers bend."""


def has_stop(description: RobotDescription) -> bool:
    """Whether every tendon ends at a section that its tendons can pull together to a stop."""
    return bool(description.tendon) and all(description.sections[i].elongation for i in description.tendon_section)


class Seating:
    """All tendons (m,) wind in together; each stands still once it carries what presses the guiders together."""

    def __init__(self, description: RobotDescription) -> None:
        assert description.tendon is not None
        configuration = Configuration(description)
        locked = configuration.rest()
        share = np.zeros(len(description.sections))
        for i, (section, index) in enumerate(zip(description.sections, configuration.lengths, strict=True)):
            if section.elongation and index is not None:
                locked[index] = section.vertebrae * section.elongation.locked_length_m
                through = sum(end >= i for end in description.tendon_section)
                stroke = section.length_m / section.vertebrae - section.elongation.locked_length_m
                share[i] = section.elongation.stiffness_N_m * stroke / through
        tendon = description.tendon
        ends = description.tendon_section
        tendons = TendonMap(description)
        self.tension_N: Floats = np.minimum(
            np.array([share[: end + 1].max() + tendon.pretension_N for end in ends]),
            LARGEST_PULL * tendon.max_tension_N,
        )
        """(m,) What holds the chambers pressed together, and the pretension on top."""
        self.stroke_m = -tendons.lengths(locked)
        """(m,) from the natural length to the stop."""
        self._release = tendons.lengths(configuration.home()) + self.stroke_m
        self._held = np.zeros(len(ends))
        self._wound = np.zeros(len(ends))
        self._released = np.zeros(len(ends))

    @property
    def seated(self) -> bool:
        return bool(np.all(self._held >= HOLD_S))

    @property
    def released(self) -> bool:
        return bool(np.all(self._released >= self._release - 1e-9))

    @property
    def overrun(self) -> NDArray[np.bool_]:
        """(m,) tendons wound in further than the chambers can shorten."""
        return np.asarray(self._wound > self.stroke_m + EXTRA_M)

    def pull(self, tension: Floats, dt_s: float) -> Floats:
        """How much to wind in now (m,) [m], from tensions with the friction taken off (m,)."""
        pressing = tension >= self.tension_N
        self._held = np.where(pressing, self._held + dt_s, 0.0)
        pace = np.where(tension >= CAREFUL_FROM * self.tension_N, CAREFUL_M_S, SPEED_M_S)
        # All wind at the pace of the tightest, so that the robot does not bend on the way.
        step = np.where(pressing, 0.0, float(pace.min()) * dt_s)
        self._wound = self._wound + step
        return step

    def release(self, dt_s: float) -> Floats:
        """How much to pay out now (m,) [m], until the tendons are where they carry their pretension."""
        left = self._release - self._released
        step = np.minimum(left, RELEASE_M_S * dt_s * self._release / self._release.max())
        self._released = self._released + step
        return step
