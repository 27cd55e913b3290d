"""Tendon-driven robots made of holes and straight pieces of tendon: recordings for the calibration's tests.

Nothing here is shared with the code under test. Sections are chains of discs turned by small rotations, a tendon's length
is the sum of the distances between its holes, and a shape is the least squares solution of bending against stretch. Every
shape is found for itself, by Gauss-Newton steps with finite differences over all samples at once.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

DISCS = 6


@dataclass(frozen=True)
class TendonRobot:
    """A robot with its true numbers."""

    length_m: np.ndarray
    """(n,)"""
    bending_Nm: np.ndarray
    """(n,) EI/L"""
    radius_m: float
    ends: np.ndarray
    """(m,) section in which each tendon ends"""
    azimuth: np.ndarray
    """(m,) [rad]"""
    gain: np.ndarray
    """(m,) true travel per travel given"""
    taut_m: np.ndarray
    """(m,) wound in beyond just taut where the travel is zero"""
    stiffness_N_m: np.ndarray
    """(m,)"""
    rest: np.ndarray
    """(n, 2) [rad]"""
    base_m: np.ndarray
    base: Rotation

    def holes(self, bends: np.ndarray) -> tuple[np.ndarray, Rotation, np.ndarray]:
        """Tendon lengths (N, m) between the holes, orientation of the tip, and its position (N, 3)."""
        count = len(bends)
        turn, place = Rotation.identity(count), np.zeros((count, 3))
        before = [place + turn.apply(self._hole(t)) for t in range(len(self.ends))]
        lengths = np.zeros((count, len(self.ends)))
        for k in range(len(self.length_m)):
            # A bend towards x turns about y. Between two discs the backbone is an arc: its chord leaves half-way turned.
            axis = np.stack([-bends[:, k, 1], bends[:, k, 0], np.zeros(count)], axis=-1) / DISCS
            half = Rotation.from_rotvec(0.5 * axis)
            chord = self.length_m[k] / DISCS * np.sinc(np.linalg.norm(axis, axis=-1) / (2.0 * np.pi))
            for _ in range(DISCS):
                turn = turn * half
                place = place + turn.apply(chord[:, None] * [0.0, 0.0, 1.0])
                turn = turn * half
                for t in np.flatnonzero(self.ends >= k):
                    hole = place + turn.apply(self._hole(t))
                    lengths[:, t] += np.linalg.norm(hole - before[t], axis=-1)
                    before[t] = hole
        return lengths, turn, place

    def _hole(self, t: int) -> list[float]:
        return [self.radius_m * np.cos(self.azimuth[t]), self.radius_m * np.sin(self.azimuth[t]), 0.0]

    def shapes(self, wound_m: np.ndarray) -> np.ndarray:
        """Bends (N, n, 2) [rad] under travel given (N, m), wound in positive."""
        n = len(self.length_m)
        straight = np.array([self.length_m[: end + 1].sum() for end in self.ends])

        def misfit(b: np.ndarray) -> np.ndarray:
            bends = b.reshape(-1, n, 2)
            lengths, _, _ = self.holes(bends)
            stretch = np.maximum(self.taut_m + self.gain * wound_m - straight + lengths, 0.0)
            bent = np.sqrt(self.bending_Nm)[:, None] * (bends - self.rest)
            return np.concatenate([bent.reshape(len(b), -1), np.sqrt(self.stiffness_N_m) * stretch], axis=-1)

        b = np.broadcast_to(self.rest.ravel(), (len(wound_m), 2 * n)).copy()
        damping = np.full(len(b), 1e-3)
        left = misfit(b)
        for _ in range(60):
            jacobian = np.stack([(misfit(b + 1e-6 * np.eye(2 * n)[i]) - left) / 1e-6 for i in range(2 * n)], axis=-1)
            gradient = np.einsum("srp,sr->sp", jacobian, left)
            hessian = np.einsum("srp,srq->spq", jacobian, jacobian)
            diagonal = damping[:, None] * np.einsum("spp->sp", hessian)
            step = np.linalg.solve(hessian + diagonal[:, :, None] * np.eye(2 * n), gradient[..., None])[..., 0]
            tried = misfit(b - step)
            better = np.sum(tried**2, axis=-1) <= np.sum(left**2, axis=-1)
            b[better] -= step[better]
            left[better] = tried[better]
            damping = np.where(better, 0.3 * damping, 10.0 * damping)
            if np.abs(step).max() < 1e-9:
                break
        return b.reshape(-1, n, 2)

    def tips(self, bends: np.ndarray) -> tuple[np.ndarray, Rotation]:
        """Tip (N, 3) [m] and its orientation in the frame of the measurement."""
        _, turn, place = self.holes(bends)
        return self.base_m + self.base.apply(place), self.base * turn


def two_sections(rng: np.random.Generator) -> TendonRobot:
    """Half a metre long, four tendons and three, soft tendons, none of its numbers a round one."""
    ends = np.array([0, 0, 0, 0, 1, 1, 1])
    azimuth = np.radians([0.0, 90.0, 180.0, 270.0, 20.0, 140.0, 260.0])
    return TendonRobot(
        length_m=np.array([0.30, 0.25]) * (1.0 + 0.01 * rng.standard_normal(2)),
        bending_Nm=np.array([1.1, 0.8]),
        radius_m=0.02,
        ends=ends,
        azimuth=azimuth + np.radians(8.0) * rng.standard_normal(7),
        gain=1.0 + 0.05 * rng.standard_normal(7),
        taut_m=0.001 * rng.uniform(0.0, 1.0, 7),
        stiffness_N_m=np.where(ends == 0, 9000.0, 6000.0),
        rest=0.05 * rng.standard_normal((2, 2)),
        base_m=np.array([0.4, -0.2, 0.9]),
        base=Rotation.from_rotvec([0.7, -1.9, 0.4]),
    )


@dataclass(frozen=True)
class Told:
    """What a robot was told, and what was seen."""

    wound_m: np.ndarray
    """(N, m) travel given"""
    motion: tuple[str, ...]
    bends: np.ndarray
    tip_m: np.ndarray
    turn: Rotation


def recording(
    robot: TendonRobot, nominal_azimuth: np.ndarray, rng: np.random.Generator, samples: int, *, paid_out: float = 1.15
) -> Told:
    """Motions in which the sections are told to bend, each alone, then together, and back.

    The tendons are told what a straight-line model with nominal azimuths asks for; a pull takes up all of its tendon, the
    others are paid out `paid_out` times as far as they need to be, so that they hang slack.
    """
    n = len(robot.length_m)
    told, names = [], []
    kinds = [tuple(float(i == k) for i in range(n)) for k in range(n)] + [(1.0,) * n, (1.0, -1.0, 1.0)[:n]]
    per = samples // (3 * len(kinds))
    for c, kind in enumerate(kinds):
        for repetition in range(3):
            towards = rng.uniform(0.0, 2.0 * np.pi)
            swing = np.sin(np.pi * (np.arange(per) + 0.5) / per)
            bend = 0.9 * np.array(kind)[:, None] * np.array([np.cos(towards), np.sin(towards)])
            told.append(swing[:, None, None] * bend)
            names += [f"motion {c}-{repetition}"] * per
    bends = np.concatenate(told)
    wound = np.zeros((len(bends), len(robot.ends)))
    for t, end in enumerate(robot.ends):
        direction = np.array([np.cos(nominal_azimuth[t]), np.sin(nominal_azimuth[t])])
        wound[:, t] = robot.radius_m * (bends[:, : end + 1] @ direction).sum(axis=-1)
    wound = np.where(wound < 0.0, paid_out * wound, wound)
    shapes = robot.shapes(wound)
    tip, turn = robot.tips(shapes)
    return Told(wound, tuple(names), shapes, tip, turn)


def mirrored(robot: TendonRobot) -> TendonRobot:
    """The same with its tendons counted the other way round."""
    return replace(robot, azimuth=-robot.azimuth)
