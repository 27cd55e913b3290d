"""How tendon lengths follow the shape: one constant matrix, because both are linear in bend vectors (C-4, S-8)."""

from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration, Floats


class MeasuredShape(NamedTuple):
    """A shape found from tendon lengths."""

    q: Floats
    """(size,) with the bends (and lengths) of the active sections from the tendons."""
    residual_m: Floats
    """(tendons,) what no shape explains: a slack, stretched, slipped or broken tendon."""

    @property
    def residual_norm_m(self) -> float:
        return float(np.linalg.norm(self.residual_m))


class TendonMap:
    """Tendon lengths of one robot, in the order of `description.tendon_names`; negative is pulled in.

    Tendon j, which ends at section i, has azimuth α_ij and radius r, and passes all sections k ≤ i:
    Δl_ij = Σ_{k ≤ i} (L_k − L_k,rest) − r Σ_{k ≤ i} b_k · [cos α_ij, sin α_ij]      (C-4, S-8)
    """

    def __init__(self, description: RobotDescription) -> None:
        self.configuration = Configuration(description)
        self.rest = self.configuration.rest()
        self.matrix = _matrix(self.configuration)
        """(tendons, size): ∂Δl/∂q [m/rad, 1], constant; its columns for twist and feed are zero."""
        self.columns = _active_columns(self.configuration)
        """Entries of q that the tendons decide."""
        own = self.matrix[:, self.columns]
        if np.linalg.matrix_rank(own) < len(self.columns):
            raise ValueError(
                f"{description.name}: {len(description.tendon_names)} tendons do not decide the "
                f"{len(self.columns)} bends and lengths of the active sections; add tendons or spread their azimuths"
            )
        self._inverse = np.linalg.pinv(own) if self.columns.size else np.zeros((0, len(self.matrix)))

    @property
    def bending(self) -> Floats:
        """(tendons, tendons) projector onto the length changes that bend the robot; the rest only pretensions it."""
        return self.matrix[:, self.columns] @ self._inverse

    def lengths(self, q: Floats) -> Floats:
        """Δl of each tendon from the straight robot at rest (..., tendons) [m] at q (..., size)."""
        return (q - self.rest) @ self.matrix.T

    def rates(self, q_rate: Floats) -> Floats:
        """Δl̇ of each tendon (..., tendons) [m/s]: the same matrix."""
        return q_rate @ self.matrix.T

    def shape(self, delta_l: Floats, q_known: Floats) -> MeasuredShape:
        """The shape that fits the tendon lengths best (least squares).

        Twist, feed and passive sections, which no tendon tells, are taken from `q_known`.
        """
        q = np.array(q_known, dtype=float)
        q[self.columns] = self.rest[self.columns]
        q[self.columns] += self._inverse @ (np.asarray(delta_l) - self.lengths(q))
        return MeasuredShape(q, np.asarray(delta_l) - self.lengths(q))


def _matrix(configuration: Configuration) -> Floats:
    description = configuration.description
    rows = []
    for last, end in enumerate(description.sections):
        if end.routing is None:
            continue
        for azimuth in np.radians(end.routing.azimuths_deg):
            row = np.zeros(configuration.size)
            for k in range(last + 1):
                row[configuration.bends[k]] = (
                    -end.routing.radius_m * np.cos(azimuth),
                    -end.routing.radius_m * np.sin(azimuth),
                )
                index = configuration.lengths[k]
                if index is not None:
                    row[index] = 1.0
            rows.append(row)
    matrix = np.array(rows).reshape(len(rows), configuration.size)
    matrix.flags.writeable = False
    return matrix


def _active_columns(configuration: Configuration) -> np.ndarray:
    columns: list[int] = []
    for i in configuration.description.active_sections:
        bend, index = configuration.bends[i], configuration.lengths[i]
        columns += [bend.start, bend.start + 1, *(() if index is None else (index,))]
    return np.array(columns, dtype=np.int64)
