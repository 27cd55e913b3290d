"""Walls that the robot touches: a rigid shell of triangles in MuJoCo, a skin of capsules on the vertebrae, and what presses."""

from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np

from cobra.simulation.environments import Environment
from cobra.simulation.plant import Floats

WALL_BIT: Final = 2
SKIN_BIT: Final = 1
"""Walls meet skins; neither meets its like."""
FRICTION = 0.25
"""Of a body sliding along a wall."""
SHELL_M = 2e-4
"""Half the thickness of the walls."""
SOLREF = (0.004, 1.0)
SOLIMP = (0.95, 0.99, 2e-4, 0.5, 2.0)
BEHIND_PORT_M = -0.002
"""What lies further back does not touch: there the introducer is."""


@dataclass(frozen=True, slots=True)
class Contacts:
    """Where the walls press, one row a place."""

    points: Floats
    """(k, 3) [m]"""
    forces: Floats
    """(k, 3) on the robot [N]"""


NO_CONTACTS: Final = Contacts(np.zeros((0, 3)), np.zeros((0, 3)))


def add_walls(spec: Any, environment: Environment) -> None:
    """The environment as a rigid shell. Only what is not behind the port can be touched."""
    corners = environment.vertices[environment.faces]
    faces = environment.faces[corners[:, :, 2].max(axis=1) > BEHIND_PORT_M]
    used, faces = np.unique(faces, return_inverse=True)
    spec.add_flex(
        name="walls",
        dim=2,
        vert=environment.vertices[used].ravel().tolist(),
        elem=faces.ravel().tolist(),
        vertbody=["world"],
        radius=SHELL_M,
        contype=WALL_BIT,
        conaffinity=SKIN_BIT,
        condim=3,
        friction=(FRICTION, 0.0, 0.0),
        solref=SOLREF,
        solimp=SOLIMP,
        selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
    )


def add_skin(body: Any, start_m: float, end_m: float, radius_m: float) -> None:
    """A capsule along z from `start_m` to `end_m` in a body, round caps beyond; it has no mass."""
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=(0.0, 0.0, start_m, 0.0, 0.0, end_m),
        size=(radius_m, 0.0, 0.0),
        contype=SKIN_BIT,
        conaffinity=WALL_BIT,
        condim=3,
        friction=(FRICTION, 0.0, 0.0),
        solref=SOLREF,
        solimp=SOLIMP,
    )


def pressing(data: mujoco.MjData) -> Contacts:
    """The contacts of the step just solved. To be read before the next one begins."""
    contact = data.contact
    address = contact.efc_address
    active = address >= 0
    if not active.any():
        return NO_CONTACTS
    # Elliptic cones: each contact has its force along its frame's three axes in a row.
    rows = address[active][:, None] + np.arange(3)
    local = data.efc_force[rows]
    frames = contact.frame[active].reshape(-1, 3, 3)
    world = np.einsum("kij,ki->kj", frames, local)
    # The frame's first axis points from the first to the second; force acts on the second.
    skin_first = contact.geom[active][:, 0] >= 0
    return Contacts(contact.pos[active].copy(), np.where(skin_first[:, None], -world, world))
