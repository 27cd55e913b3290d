"""Tendons and drives of a robot's MuJoCo model: what runs through the holes of its body, and what sets their lengths."""

from collections.abc import Iterator
from typing import Any

import mujoco

from cobra.description import Drive, RobotDescription, Tendon
from cobra.simulation.chain_body import ChainBody
from cobra.simulation.chain_parts import HAND, STEP_DAMPING_S, YIELD_RATIO, Kind, piece_name

IDEAL_RATIO = 150.0
"""Stiffness of an ideal tendon against the bending stiffness of its section, k r₀² = ratio · EI/ℓ."""
FEED_STIFFNESS_N_m = 2e5
TWIST_STIFFNESS_Nm_rad = 500.0


class ChainTendons:
    """Adds tendons and actuators to a specification whose body is built."""

    def __init__(self, description: RobotDescription, kind: Kind, spec: Any, body: ChainBody) -> None:
        self.description = description
        self.kind = kind
        self._spec = spec
        self._holes = body.holes
        self._path_ends = body.path_ends
        tendon = description.tendon
        self.frictional = (
            kind == "default"
            and tendon is not None
            and (tendon.hole_friction > 0.0 or tendon.conduit_friction * tendon.conduit_bend_deg > 0.0)
        )

    def build(self) -> None:
        """Add all of it."""
        self._add_tendons()
        for drive in self.description.drives:
            self._add_drive(drive)
        if self.description.hand_fed:
            self._add_servo(HAND, "feed", mujoco.mjtTrn.mjTRN_JOINT, FEED_STIFFNESS_N_m)

    def stiffness(self, name: str) -> float:
        """k of a tendon [N/m]: EA over conduit and path, or stiff against the backbone for the ideal twin."""
        d = self.description
        section = d.sections[d.tendon_section[d.tendon_names.index(name)]]
        if self.kind == "ideal" and section.routing:
            return IDEAL_RATIO * section.bending_stiffness_Nm2 / section.length_m / section.routing.radius_m**2
        return self._tendon.axial_stiffness_N / (self._tendon.conduit_length_m + self._path_ends[name])

    def rest_length(self, model: mujoco.MjModel, name: str) -> float:
        """Of a tendon's path along the straight robot [m]."""
        return float(sum(model.tendon_length0[model.tendon(part).id] for part, _ in self._parts(name)))

    @property
    def _tendon(self) -> Tendon:
        tendon = self.description.tendon
        if tendon is None:
            raise ValueError(f"{self.description.name}: has tendons, but does not say what they are made of")
        return tendon

    def _add_tendons(self) -> None:
        for name in self._holes:
            for part, sites in self._parts(name):
                tendon = self._spec.add_tendon(name=part)
                for site in sites:
                    tendon.wrap_site(site)

    def _parts(self, name: str) -> Iterator[tuple[str, list[str]]]:
        """Name and sites of what a tendon is made of: one part, or one in every section if it rubs."""
        holes = self._holes[name]
        if not self.frictional:
            yield name, [site for site, _ in holes]
            return
        for section in range(holes[-1][1] + 1):
            own = [i for i, (_, at) in enumerate(holes) if at == section]
            # It begins where the section before ends.
            yield piece_name(name, section), [site for site, _ in holes[max(own[0] - 1, 0) : own[-1] + 1]]

    def _add_drive(self, drive: Drive) -> None:
        """A drive sets a length, with stiffness and damping; on a tendon it can only pull.

        What a drive does to a tendon that rubs is for `cables.py` to say: its pieces get forces.
        """
        if drive.moves == "tendon" and self.frictional:
            for part, _ in self._parts(str(drive.tendon)):
                self._spec.add_actuator(
                    name=part,
                    target=part,
                    trntype=mujoco.mjtTrn.mjTRN_TENDON,
                    gaintype=mujoco.mjtGain.mjGAIN_FIXED,
                    gainprm=[1.0, *[0.0] * 9],
                    biastype=mujoco.mjtBias.mjBIAS_AFFINE,
                    biasprm=[0.0] * 10,
                    forcelimited=True,
                    forcerange=(-YIELD_RATIO * self._tendon.max_tension_N, 0.0),
                )
            return
        if drive.moves == "tendon":
            stiffness = self.stiffness(str(drive.tendon))
            weakest = -YIELD_RATIO * self._tendon.max_tension_N
            self._add_servo(f"drive {drive.name}", drive.tendon, mujoco.mjtTrn.mjTRN_TENDON, stiffness, weakest)
        else:
            stiffness = FEED_STIFFNESS_N_m if drive.moves == "feed" else TWIST_STIFFNESS_Nm_rad
            self._add_servo(f"drive {drive.name}", drive.moves, mujoco.mjtTrn.mjTRN_JOINT, stiffness)

    def _add_servo(
        self, name: str, target: str | None, transmission: Any, stiffness: float, weakest: float | None = None
    ) -> None:
        """What sets a length; with `weakest` it can only pull, by that much [N]."""
        self._spec.add_actuator(
            name=name,
            target=target,
            trntype=transmission,
            gaintype=mujoco.mjtGain.mjGAIN_FIXED,
            gainprm=[stiffness, *[0.0] * 9],
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            biasprm=[0.0, -stiffness, -stiffness * STEP_DAMPING_S, *[0.0] * 7],
            forcelimited=weakest is not None,
            forcerange=(weakest or 0.0, 0.0),
        )
