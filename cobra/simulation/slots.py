"""The contact of SRC-Bot's guiders in the MuJoCo twin, and their skewed slots: where they touch straight enough they catch.

A chamber shorter than its locked length is as stiff as its guiders are. The slots hold bend and twist from the touch until
the chamber is longer than the unlocking length (MODEL 3). Both are stiffer springs of the chamber's own joints, damped as all
others: as limits of MuJoCo's they would bounce, since the chambers weigh little beside the damping of their cables.
"""

import mujoco
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.simulation.chain import Chain
from cobra.simulation.chain_parts import SETTLING_S, STEP_DAMPING_S
from cobra.simulation.plant import Floats

CONTACT_N_m = 1e6
"""Stiffness of guiders pressed together."""
HOLD_Nm_rad = 200.0
"""Stiffness of caught guiders, in each of the joints between them: fifty times a chamber's."""


class Slots:
    """State of all chambers of a twin. `update` after every step of the physics."""

    def __init__(self, description: RobotDescription, chain: Chain) -> None:
        rows: dict[tuple[int, float], dict[str, list[int]]] = {}
        ends: dict[int, list[float]] = {}
        for spring, joint in zip(chain.springs, chain.joints, strict=True):
            if spring.does == "slide":
                ends.setdefault(spring.section, []).append(spring.end_m)
                rows[(spring.section, spring.end_m)] = {
                    "bend_x": [],
                    "bend_y": [],
                    "torsion": [],
                    "slide": [int(joint)],
                }
        for spring, joint in zip(chain.springs, chain.joints, strict=True):
            if spring.section in ends and spring.does != "slide":
                end = min(e for e in ends[spring.section] if e >= spring.end_m - 1e-9)
                rows[(spring.section, end)][spring.does].append(int(joint))
        parts = [(description.sections[i], row) for (i, _), row in sorted(rows.items())]
        self._slides = np.array([row["slide"][0] for _, row in parts], dtype=np.intp)
        self._bend_x = np.array([row["bend_x"] for _, row in parts], dtype=np.intp).reshape(len(parts), -1)
        self._bend_y = np.array([row["bend_y"] for _, row in parts], dtype=np.intp).reshape(len(parts), -1)
        self._torsion = np.array([row["torsion"] for _, row in parts], dtype=np.intp).reshape(len(parts), -1)
        pitch = np.array([section.length_m / section.vertebrae for section, _ in parts])
        elongations = [section.elongation for section, _ in parts if section.elongation]
        self._touching_m = np.array([e.locked_length_m for e in elongations]) - pitch
        self._letting_go_m = np.array([e.unlocked_length_m for e in elongations]) - pitch
        self._straight = np.radians([e.lock_bend_deg for e in elongations])
        self._axial = chain.model.jnt_stiffness[self._slides]
        self._rest = chain.model.qpos_spring[self._slides].copy()
        # Where the stiff spring takes over with the force that the chamber's has there.
        self._pressed_rest = self._touching_m - self._axial * (self._touching_m - self._rest) / CONTACT_N_m
        self._joints = np.concatenate([self._bend_x, self._bend_y, self._torsion], axis=1)
        self._free = chain.model.jnt_stiffness[self._joints]
        self._touch: NDArray[np.bool_] = np.zeros(len(parts), dtype=np.bool_)
        self.caught: NDArray[np.bool_] = np.zeros(len(parts), dtype=np.bool_)
        """(chambers,) base first."""

    def update(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Touch, catch or let go, from where the joints stand now."""
        q: Floats = data.qpos
        length = q[self._slides]
        touch = length < self._touching_m
        if not (touch.any() or self._touch.any() or self.caught.any()):
            return
        bend = np.hypot(q[self._bend_x].sum(axis=1), q[self._bend_y].sum(axis=1))
        caught = (self.caught & (length < self._letting_go_m)) | (touch & (bend <= self._straight))
        axial = np.where(touch, CONTACT_N_m, self._axial)
        model.jnt_stiffness[self._slides] = axial
        model.qpos_spring[self._slides] = np.where(touch, self._pressed_rest, self._rest)
        model.dof_damping[self._slides] = SETTLING_S * self._axial + STEP_DAMPING_S * axial
        across = np.where(caught[:, None], np.maximum(HOLD_Nm_rad, self._free), self._free)
        model.jnt_stiffness[self._joints] = across
        model.dof_damping[self._joints] = SETTLING_S * self._free + STEP_DAMPING_S * across
        self._touch, self.caught = touch, caught
