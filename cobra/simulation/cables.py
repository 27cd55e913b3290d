"""Tendons with friction: elastic, sliding through conduit and vertebrae, with a tension that differs along the way.

A tendon is a row of elastic elements: the conduit's, and one in every section that it passes. Between them it rubs, by the
conduit's bends and by what the sections are bent just now (capstan, MODEL.md 5). Which way it rubs is not commanded but follows
from what has moved before: the tension stays anywhere between the two bounds until it must slide.
"""

import mujoco
import numpy as np

from cobra.description import RobotDescription, Tendon
from cobra.simulation.cable_kernels import relax, tangent
from cobra.simulation.chain import Chain
from cobra.simulation.chain_parts import PASSIVE, STEP_DAMPING_S, Indices
from cobra.simulation.plant import Floats

CONDUIT_NODES = 4
"""Places at which the conduit's friction is gathered; with four the lost motion on a reversal is right to 2 %."""
JAMMED = 1e9
"""Ratio of tensions that a jammed tendon holds."""


class Cables:
    """The tendons of one twin, with what they remember. Arrays are (tendons, elements), elements from the motor on."""

    def __init__(self, description: RobotDescription, tendon: Tendon, chain: Chain) -> None:
        if chain.pieces is None or chain.piece_tendons is None:
            raise ValueError("the chain has been built for tendons without friction")
        sections = len(description.sections)
        self._model = chain.model
        self._tendon = tendon
        self._pieces = chain.pieces
        self._own = chain.pieces >= 0
        self._first = CONDUIT_NODES + 1
        self._counts = self._first + self._own.sum(axis=1)
        lengths = np.zeros((len(self._counts), self._first + sections))
        share = np.full(self._first, 1.0 / CONDUIT_NODES)
        share[[0, -1]] /= 2.0
        # A robot without conduit still has a little cable between spool and port.
        lengths[:, : self._first] = max(tendon.conduit_length_m, 0.1) * share
        lengths[:, self._first :] = [section.length_m for section in description.sections]
        self._stiffness = tendon.axial_stiffness_N / lengths
        self._at_rest = np.where(self._own, chain.model.tendon_length0[np.maximum(chain.piece_tendons, 0)], 0.0)
        self._piece_tendons = np.maximum(chain.piece_tendons, 0)
        self._last = self._at_rest.copy()
        self._extension = np.zeros_like(lengths)
        self._tension = np.zeros_like(lengths)
        self._tangent = np.zeros_like(lengths)
        self._travel = np.zeros(len(self._counts))
        self._capstan = np.ones((len(lengths), lengths.shape[1] - 1))
        self._conduit_angle = tendon.conduit_friction * tendon.conduit_bend_rad / CONDUIT_NODES
        self._capstan[:, :CONDUIT_NODES] = np.exp(self._conduit_angle)
        self._bend_x, self._bend_y, self._section = _bend_joints(chain)
        self._jammed = np.zeros(len(lengths), dtype=np.bool_)
        self._half_bends = np.zeros(1 + sections)

    @property
    def motor_tension(self) -> Floats:
        """(tendons,) [N]"""
        return self._tension[:, 0]

    @property
    def profile(self) -> Floats:
        """(tendons, 2 + sections) tension at the motor, at the port, and at the end of each section [N]; NaN beyond its end."""
        first, half = self._first, self._half_bends
        port = self._tension[:, first - 1 : first]
        middles = self._tension[:, first:]
        before = np.concatenate([port, middles[:, :-1]], axis=1)
        after = np.concatenate([middles[:, 1:], middles[:, -1:]], axis=1)
        # Along a bend the logarithm of the tension falls evenly; an element has the tension of its section's middle.
        lasts = np.arange(middles.shape[1]) == (self._counts - first - 1)[:, None]
        inward = half[1:] / np.maximum(half[:-1] + half[1:], 1e-12)
        outward = half[1:] / np.maximum(half[1:] + np.append(half[2:], 0.0), 1e-12)
        ends = np.where(lasts, _power(middles, before, -inward), _power(middles, after, outward))
        ends[~self._own] = np.nan
        return np.concatenate([self._tension[:, :1], port, ends], axis=1)

    def memory(self) -> tuple[Floats, Floats, Floats]:
        """What `restore` takes to come back to the present state."""
        return self._extension.copy(), self._last.copy(), self._travel.copy()

    def restore(self, memory: tuple[Floats, Floats, Floats]) -> None:
        """Back to where `memory` was taken."""
        self._extension[:], self._last[:], self._travel[:] = memory

    def break_tendon(self, index: int) -> None:
        """From now on it carries nothing."""
        self._stiffness[index] = 0.0

    def jam(self, index: int) -> None:
        """From now on it is stuck in its conduit, just before the port."""
        self._jammed[index] = True

    def slip(self, index: int, length_m: float) -> None:
        """Let `length_m` of it slip on its spool, once."""
        self._extension[index, 0] -= length_m

    def step(self, data: mujoco.MjData, travel: Floats) -> None:
        """Set the forces of all pieces for the travel (tendons,) [m paid out] and the lengths in `data`."""
        lengths = np.where(self._own, data.ten_length[self._piece_tendons], 0.0)
        self._extension[:, self._first :] += lengths - self._last
        self._extension[:, 0] -= travel - self._travel
        self._last, self._travel = lengths, travel.copy()
        self._set_capstan(data)
        relax(self._extension, self._stiffness, self._capstan, self._counts, self._tension)
        tangent(self._tension, self._stiffness, self._capstan, self._counts, self._first, self._tangent)
        pieces = self._pieces[self._own]
        data.ctrl[pieces] = -self._tension[:, self._first :][self._own]
        # Only what is taut damps: a slack tendon must not pull.
        self._model.actuator_biasprm[pieces, 2] = -STEP_DAMPING_S * self._tangent[:, self._first :][self._own]

    def _set_capstan(self, data: mujoco.MjData) -> None:
        bends = np.hypot(data.qpos[self._bend_x], data.qpos[self._bend_y])
        own = self._section != PASSIVE
        angle = np.bincount(self._section[own], weights=bends[own], minlength=self._pieces.shape[1])
        if not own.all():
            # What the walls bend of the passive body rubs in its conduits, next to the port.
            rubs = self._conduit_angle + self._tendon.conduit_friction * bends[~own].sum()
            self._capstan[:, self._first - 2] = np.exp(rubs)
        half = self._half_bends
        half[1:] = angle / 2.0
        # From the middle of one section to the middle of the next; into the first from the port.
        between = np.exp(self._tendon.hole_friction * (half[:-1] + half[1:]))
        self._capstan[:, self._first - 1 :] = between
        self._capstan[self._jammed, self._first - 2] = JAMMED


def _power(tension: Floats, other: Floats, share: Floats) -> Floats:
    """From `tension` by a share of the ratio to `other`; unchanged where either is slack."""
    known = (tension > 0.0) & (other > 0.0)
    ratio = np.where(known, other, 1.0) / np.where(known, tension, 1.0)
    return np.asarray(tension * ratio**share)


def _bend_joints(chain: Chain) -> tuple[Indices, Indices, Indices]:
    """Joints of each universal joint, about both axes, and its section."""
    x = [(j, s.section) for s, j in zip(chain.springs, chain.joints, strict=True) if s.does == "bend_x"]
    y = [j for s, j in zip(chain.springs, chain.joints, strict=True) if s.does == "bend_y"]
    return np.array([j for j, _ in x]), np.array(y), np.array([section for _, section in x])
