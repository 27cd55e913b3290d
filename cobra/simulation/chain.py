"""A robot description as a MuJoCo model: a chain of vertebrae on elastic joints, with tendons through their holes.

Every interval between two vertebrae bends in the middle of its gap by a universal joint of stiffness EI/pitch, where a
polygon follows an arc best, up to where the vertebrae meet. The order of the joint's two axes alternates along the
chain: a series of universal joints all alike would twist the body when it bends between its axes. A chamber that can
change its length has two such joints at the Gauss points of its gap, and between them a slide of stiffness K and a
torsion hinge of stiffness GJ/pitch (S-38). Other sections have one torsion hinge each, inside their middle vertebra.
"""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from cobra.description import RobotDescription
from cobra.simulation.chain_body import ChainBody
from cobra.simulation.chain_parts import HAND, STEP_S, Indices, Kind, Spring, piece_name
from cobra.simulation.chain_tendons import ChainTendons
from cobra.simulation.contacts import add_walls
from cobra.simulation.environments import Environment
from cobra.simulation.plant import Floats


@dataclass(frozen=True)
class Chain:
    """The compiled model and where in it things are. `n` springs, `m` tendons."""

    model: mujoco.MjModel
    springs: tuple[Spring, ...]
    joints: Indices
    """(n,) joint of each spring. Every joint has one degree of freedom, so this is its index in `qpos` and `qvel` too."""
    vertebra_sites: Indices
    """Centres of the vertebrae, base first, without the plate at the base."""
    vertebra_bodies: Indices
    passive_sites: Indices
    """Ends of the passive body's links, base first; none in free space."""
    tip_site: int
    tendon_stiffness: Floats
    """(m,) k [N/m], m as `RobotDescription.tendon_names`."""
    tendon_rest: Floats
    """(m,) length of each tendon's path along the straight robot [m]."""
    drive_actuators: Indices
    """(drives,) actuator of each drive; −1 for a tendon that is made of pieces."""
    hand_actuator: int
    """Of the hand that feeds the robot; −1 where none does."""
    longest_m: float
    """Exposed length beyond which the hand cannot feed, for want of a body [m]."""
    pieces: Indices | None
    """(m, sections) actuator that pulls each tendon within each section, −1 beyond its end; None without friction."""
    piece_tendons: Indices | None
    """(m, sections) MuJoCo's tendon of each piece, −1 beyond its end."""


def build_chain(
    description: RobotDescription, kind: Kind, payload_kg: float = 0.0, environment: Environment | None = None
) -> Chain:
    """Generate and compile the model of a robot, and of the walls around it.

    `kind` "default" has the description's tendons and gravity, "ideal" stiff tendons and no gravity.
    """
    spec = mujoco.MjSpec()
    _set_options(spec, description, kind, environment is not None)
    body = ChainBody(description, spec, payload_kg, environment is not None)
    body.build()
    tendons = ChainTendons(description, kind, spec, body)
    tendons.build()
    if environment is not None:
        add_walls(spec, environment)
    model = spec.compile()
    joints = np.array([model.joint(spring.name).id for spring in body.springs], dtype=np.intp)
    names = [f"vertebra {k}" for k in range(1, body.vertebrae + 1)]
    sections = range(len(description.sections))

    def found(kind: mujoco.mjtObj, name: str) -> int:
        return mujoco.mj_name2id(model, kind, name)

    def pieces(kind: mujoco.mjtObj) -> Indices:
        rows = [[found(kind, piece_name(name, i)) for i in sections] for name in description.tendon_names]
        return np.array(rows, dtype=np.intp)

    sites = np.array([model.site(name).id for name in names], dtype=np.intp)
    return Chain(
        model=model,
        springs=tuple(body.springs),
        joints=joints,
        vertebra_sites=sites,
        vertebra_bodies=np.asarray(model.site_bodyid[sites], dtype=np.intp),
        passive_sites=np.array(
            [i for i in range(model.nsite) if model.site(i).name.startswith("passive ")], dtype=np.intp
        ),
        tip_site=model.site("tip").id,
        tendon_stiffness=np.array([tendons.stiffness(name) for name in description.tendon_names]),
        tendon_rest=np.array([tendons.rest_length(model, name) for name in description.tendon_names]),
        drive_actuators=np.array(
            [found(mujoco.mjtObj.mjOBJ_ACTUATOR, f"drive {drive.name}") for drive in description.drives], dtype=np.intp
        ),
        hand_actuator=found(mujoco.mjtObj.mjOBJ_ACTUATOR, HAND),
        longest_m=body.longest_m,
        pieces=pieces(mujoco.mjtObj.mjOBJ_ACTUATOR) if tendons.frictional else None,
        piece_tendons=pieces(mujoco.mjtObj.mjOBJ_TENDON) if tendons.frictional else None,
    )


def _set_options(spec: Any, description: RobotDescription, kind: Kind, walled: bool) -> None:
    option = spec.option
    option.timestep = STEP_S
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.gravity = description.backbone.gravity_m_s2 if kind == "default" else (0.0, 0.0, 0.0)
    # A bad state must be seen and mended by the twin, not silently replaced by the initial one.
    option.disableflags = mujoco.mjtDisableBit.mjDSBL_AUTORESET
    if not walled:
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.compiler.autolimits = False
    spec.compiler.degree = False
