"""How the pretension is shared among the tendons so that it leaves a straight robot straight."""

from typing import Any

import daqp
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

LEAST_SHARE = 0.2
"""No tendon gets less of the pretension."""
_OPTIMAL = 1
_EQUALITY = 5
"""daqp's exit flag, and its sense of an equality."""


def pretension_shares(description: RobotDescription) -> NDArray[np.float64]:
    """Tension of each tendon of a straight robot in shares of the pretension (m,), on average 1 in every section.

    A section stays straight when its tendons' tensions T have no moment: Σ T_j [cos α_j, sin α_j] = 0. Of those the
    nearest to all equal; so equal they are where the azimuths are even.
    """
    shares = [_balanced(section.routing.azimuths_deg) for section in description.sections if section.routing]
    return np.concatenate([np.zeros(0), *shares])


def _balanced(azimuths_deg: tuple[float, ...]) -> NDArray[np.float64]:
    azimuths, n = np.radians(azimuths_deg), len(azimuths_deg)
    rows = np.stack([np.cos(azimuths), np.sin(azimuths), np.ones(n)])
    low = np.concatenate([np.full(n, LEAST_SHARE), [0.0, 0.0, n]])
    high = np.concatenate([np.full(n, float(n)), [0.0, 0.0, n]])
    sense = np.array([0] * n + [_EQUALITY] * 3, dtype=np.intc)
    found: tuple[Any, ...] = daqp.solve(np.eye(n), -np.ones(n), rows, high, low, sense)
    # Tendons that surround the backbone barely have no such shares; then equal ones are as good as any. Rounded, so that
    # equal shares are exactly equal: currents come in counts, and a hair tips them over a threshold or not.
    return np.round(found[0], 9) if found[2] == _OPTIMAL else np.ones(n)
