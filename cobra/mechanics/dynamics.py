"""Motion of SRC-Bot under cable forces or lengths, gravity and forces on any guider (MODEL.md 4).

The default is the exact chain: M(q) q̈ + c(q, q̇) + D q̇ + ∂U/∂q = Q_cables + Σ J_iᵀ F_i in q = (b_x, b_y, ψ, L) per segment,
which has no singularity when straight. `formulation="published"` is the paper's own (`published.py`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from cobra.errors import OperatorError
from cobra.mechanics.chain import (
    Floats,
    SrcBotParameters,
    cable_lengths,
    guider_frames,
    kinetic_energy,
    potential_energy,
)
from cobra.mechanics.kernels import layout
from cobra.mechanics.kernels.marching import march
from cobra.mechanics.kernels.published import COLUMNS as PUBLISHED_COLUMNS
from cobra.mechanics.kernels.published import march_published
from cobra.mechanics.published import chain_coordinates, polar_coordinates
from cobra.mechanics.schedule import Cables, CommandKind, Load, Schedule

Formulation = Literal["chain", "published"]
Bools = np.ndarray[tuple[int, ...], np.dtype[np.bool_]]

DEFAULT_STEP_S = 0.8e-3
"""Second order: within 0.05 mm of a tenth of it in the paper's case (tests/benchmarks/test_dynamics.py)."""
RECORD_S = 0.01
SMALLEST_STEP_S = 1e-6
MARKS_A_CALL, STEPS_A_CALL = 100, 50_000
"""At most this much between two reports of progress, and between two chances to interrupt."""
_KINDS = {"forces": layout.FORCES, "lengths": layout.LENGTHS}
_COMPLAINTS = {
    layout.NOT_FINITE: "is not finite any more",
    layout.BENT: f"is bent by more than {np.degrees(layout.LARGEST_BEND_RAD):.0f} degrees",
    layout.TWISTED: f"is twisted by more than {np.degrees(layout.LARGEST_TWIST_RAD):.0f} degrees",
    layout.STRETCHED: f"has no length left, or more than {layout.LARGEST_STRETCH:g} times its natural one",
    layout.STUCK: "cannot be followed to the wanted tolerance by any step",
}


class SimulationError(OperatorError):
    """The motion blew up. The message says when and in which segment."""

    def __init__(self, verdict: int, segment: int, time_s: float) -> None:
        self.segment, self.time_s = segment, time_s
        super().__init__(
            f"the simulation blew up at t = {time_s:.6g} s: segment {segment} {_COMPLAINTS[verdict]}; "
            "smaller forces, more damping or a smaller step would help"
        )


@dataclass(frozen=True)
class Motion:
    """A motion over time; the first dimension is time."""

    parameters: SrcBotParameters
    formulation: Formulation
    time_s: Floats
    """(m,)"""
    q: Floats
    """(m, n, 4) coordinates of the chain; for the published form those of the same shape."""
    v: Floats
    """(m, n, 4) their rates; for the published form (m, n, 3), of θ, φ, L."""
    tensions_N: Floats
    """(m, cables) at the top guider."""
    motor_N: Floats
    """(m, cables) at the motors."""
    loads_N: Floats
    """(m, n, 3) external forces."""
    locked: Bools
    """(m, n) bend and twist of the chamber caught in the slots."""
    stopped: Bools
    """(m, n) the chamber's guiders touch."""
    steps: int

    @cached_property
    def frames(self) -> Floats:
        """(m, n + 1, 4, 4) of the base and of every guider."""
        return guider_frames(self.q)

    @cached_property
    def positions_m(self) -> Floats:
        """(m, n + 1, 3) of the base and of every guider."""
        return self.frames[..., :3, 3]

    @cached_property
    def tilt_rad(self) -> Floats:
        """(m, n + 1, 2) tilt of each guider's axis against the base, towards x and towards y."""
        axis = self.frames[..., :3, 2]
        aside = np.linalg.norm(axis[..., :2], axis=-1)
        angle = np.arctan2(aside, axis[..., 2])
        return axis[..., :2] * np.where(aside > 0.0, angle / np.maximum(aside, 1e-300), 1.0)[..., None]

    @cached_property
    def cable_lengths_m(self) -> Floats:
        """(m, cables) L_d."""
        return cable_lengths(self.parameters, self.q)

    def energy_J(self) -> Floats:
        """(m,) kinetic and potential energy of the chain."""
        if self.formulation != "chain":
            raise ValueError("the published equations have no conserved energy")
        return kinetic_energy(self.parameters, self.q, self.v) + potential_energy(self.parameters, self.q)


class Chain:
    """A chain that lives: the state of one SRC-Bot, marched on by whoever holds it."""

    def __init__(self, parameters: SrcBotParameters, q: Floats | None = None, tensions_N: Floats | None = None) -> None:
        """At rest at q (n, 4), else straight at its natural length, with cable tensions (cables,), else slack.

        Raises:
            ValueError: q has another shape, is not finite, or a chamber is shorter than its stop allows.
        """
        self.parameters = parameters
        n, k = parameters.segments, len(parameters.cable_azimuths_deg)
        q = parameters.rest if q is None else np.array(q, dtype=np.float64)
        if q.shape != (n, 4) or not np.isfinite(q).all():
            raise ValueError(f"q must be a finite array ({n}, 4), but has the shape {q.shape}")
        if (q[:, 3] < parameters.locked_length_m - 1e-9).any():
            i = int(np.argmin(q[:, 3]))
            raise ValueError(
                f"segment {i + 1} starts {q[i, 3] * 1e3:.4g} mm long; the guiders touch at {parameters.locked_length_m * 1e3:g} mm"
            )
        self._state = np.zeros((n, layout.STATE_COLUMNS))
        self._state[:, :4] = q
        touching = q[:, 3] <= parameters.locked_length_m + 1e-9
        self._state[:, layout.STOPPED] = touching
        self._state[:, layout.LOCKED] = touching & (np.hypot(q[:, 0], q[:, 1]) <= parameters.constants.lock_bend)
        self._rope = np.stack([np.zeros(k) if tensions_N is None else tensions_N, cable_lengths(parameters, q)])

    @property
    def q(self) -> Floats:
        """(n, 4)"""
        return self._state[:, layout.Q : layout.Q + 4].copy()

    @property
    def v(self) -> Floats:
        """(n, 4)"""
        return self._state[:, layout.V : layout.V + 4].copy()

    @v.setter
    def v(self, rates: Floats) -> None:
        self._state[:, layout.V : layout.V + 4] = rates

    @property
    def tensions_N(self) -> Floats:
        """(cables,) at the top guider."""
        return self._rope[layout.TENSION].copy()

    @property
    def cable_lengths_m(self) -> Floats:
        """(cables,) L_d."""
        return cable_lengths(self.parameters, self.q)

    @property
    def locked(self) -> Bools:
        """(n,) chambers whose bend and twist the slots hold; all of them: the rigid status."""
        return self._state[:, layout.LOCKED] > 0.0

    @property
    def stopped(self) -> Bools:
        """(n,) chambers whose guiders touch."""
        return self._state[:, layout.STOPPED] > 0.0

    def advance(
        self,
        duration_s: float,
        *,
        forces_N: Floats | None = None,
        lengths_m: Floats | None = None,
        loads_N: Floats | None = None,
        step_s: float = DEFAULT_STEP_S,
    ) -> None:
        """Let time pass under constant motor forces or cable lengths (cables,) and forces on the guiders (n, 3).

        Raises:
            SimulationError: the motion blew up; the state stays what it was before.
        """
        n, k = self.parameters.segments, self._rope.shape[1]
        command = lengths_m if lengths_m is not None else forces_N if forces_N is not None else np.zeros(k)
        kind = layout.LENGTHS if lengths_m is not None else layout.FORCES
        loads = np.zeros((n, 3)) if loads_N is None else np.asarray(loads_N, dtype=np.float64)
        times = np.array([0.0, duration_s])
        commands = np.broadcast_to(np.asarray(command, dtype=np.float64), (1, 2, k)).copy()
        self.march(kind, np.array([step_s]), 0.0, times, commands, np.broadcast_to(loads, (1, 2, n, 3)).copy())

    def march(
        self, kind: int, size: Floats, tolerance_m: float, times: Floats, commands: Floats, loads: Floats
    ) -> tuple[Floats, Floats, int]:
        """States (marks, n, columns of `layout.py`), tensions (marks, cables) and the number of steps; see `marching.march`.

        Raises:
            SimulationError: the motion blew up; the state stays what it was before.
        """
        p = self.parameters
        before = self._state.copy(), self._rope.copy()
        states = np.empty((len(times), *self._state.shape))
        tensions = np.empty((len(times), self._rope.shape[1]))
        states[0], tensions[0] = self._state, self._rope[layout.TENSION]
        verdict, segment, time, steps = march(
            p.constants, p.cable_matrix, kind, size, tolerance_m, times, commands, loads, self._state, self._rope, states, tensions
        )  # fmt: skip
        if verdict != layout.FINE:
            self._state[:], self._rope[:] = before
            raise SimulationError(verdict, segment + 1, time)
        return states, tensions, steps


def simulate(
    parameters: SrcBotParameters,
    duration_s: float,
    cables: Cables,
    loads: Sequence[Load] = (),
    *,
    start: Chain | None = None,
    formulation: Formulation = "chain",
    step_s: float = DEFAULT_STEP_S,
    tolerance_m: float | None = None,
    record_s: float = RECORD_S,
    progress: Callable[[float], None] | None = None,
) -> Motion:
    """The motion from `start` (else straight, at rest, slack) over `duration_s`, recorded every `record_s` and at every jump.

    Args:
        start: where it begins; the chain moves along, and is left where the motion ends (not in the published form).
        step_s: size of the fixed step; with `tolerance_m` the first one tried.
        tolerance_m: keeps what one step errs below this, by adapting its size (chain only).
        progress: called with the simulated time [s] now and then.

    Raises:
        ValueError: a load on a guider that does not exist, commands for another number of cables, a size that is not positive.
        SimulationError: the motion blew up; says when and in which segment.
    """
    n, k = parameters.segments, len(parameters.cable_azimuths_deg)
    sizes = {"duration_s": duration_s, "step_s": step_s, "record_s": record_s}
    _check(n, k, cables, loads, sizes if tolerance_m is None else sizes | {"tolerance_m": tolerance_m})
    chain = Chain(parameters) if start is None else start
    marks = _marks(duration_s, record_s, [*cables.schedules, *(load.force for load in loads)])
    commands = cables.over(marks)
    forces = np.zeros((len(marks) - 1, 2, n, 3))
    for load in loads:
        forces[:, :, load.guider - 1] += load.force.over(marks)
    run = (
        _chain_runner(chain, cables.kind, step_s, tolerance_m)
        if formulation == "chain"
        else _published_runner(chain, cables.kind, step_s, _first_plane(chain, cables.kind, commands, forces))
    )
    parts, steps = [], 0
    a_call = int(np.clip(STEPS_A_CALL * step_s / record_s, 1, MARKS_A_CALL))
    for first in range(0, len(marks) - 1, a_call):
        part = slice(first, first + a_call)
        *track, taken = run(marks[first : first + a_call + 1], commands[part], forces[part])
        parts.append([rows[1:] if first else rows for rows in track])
        steps += taken
        if progress is not None:
            progress(float(marks[min(first + a_call, len(marks) - 1)]))
    q, v, tensions, flags = (np.concatenate(rows) for rows in zip(*parts, strict=True))
    shown = np.concatenate([commands[:1, 0], commands[:, 1]])
    motor = (
        shown
        if cables.kind == "forces"
        else np.maximum(parameters.cable_stiffness_N_m * (cable_lengths(parameters, q) - shown), 0.0)
    )
    return Motion(
        parameters, formulation, marks, q, v, tensions, motor, np.concatenate([forces[:1, 0], forces[:, 1]]),
        flags[..., 0] > 0.0, flags[..., 1] > 0.0, steps,
    )  # fmt: skip


_Run = Callable[[Floats, Floats, Floats], tuple[Floats, Floats, Floats, Floats, int]]
"""Marks, commands, forces → q, v, tensions, flags at the marks, and the number of steps."""


def _chain_runner(chain: Chain, kind: CommandKind, step_s: float, tolerance_m: float | None) -> _Run:
    size = np.array([step_s])

    def run(marks: Floats, commands: Floats, forces: Floats) -> tuple[Floats, Floats, Floats, Floats, int]:
        states, tensions, steps = chain.march(_KINDS[kind], size, tolerance_m or 0.0, marks, commands, forces)
        q, v = states[..., layout.Q : layout.Q + 4], states[..., layout.V : layout.V + 4]
        return q, v, tensions, states[..., [layout.LOCKED, layout.STOPPED]], steps

    return run


def _published_runner(chain: Chain, kind: CommandKind, step_s: float, plane: float) -> _Run:
    """The printed φ are twists from the plane in which the robot begins to bend, the rotation of the bottom guider."""
    p = chain.parameters
    state = np.zeros((p.segments, PUBLISHED_COLUMNS))
    state[:, :3] = polar_coordinates(chain.q)
    state[0, 1] = 0.0
    rope = np.stack([chain.tensions_N, cable_lengths(p, chain.q)])
    azimuths, radius = np.radians(p.cable_azimuths_deg) - plane, 0.5 * p.cable_circle_diameter_m
    turn = np.array([[np.cos(plane), -np.sin(plane), 0.0], [np.sin(plane), np.cos(plane), 0.0], [0.0, 0.0, 1.0]])
    gravity = np.asarray(p.gravity_m_s2) @ turn
    constants = p.constants._replace(gravity_x=gravity[0], gravity_y=gravity[1], gravity_z=gravity[2])

    def run(marks: Floats, commands: Floats, forces: Floats) -> tuple[Floats, Floats, Floats, Floats, int]:
        states = np.empty((len(marks), *state.shape))
        tensions = np.empty((len(marks), len(azimuths)))
        states[0], tensions[0] = state, rope[layout.TENSION]
        verdict, segment, time, steps = march_published(
            constants,
            azimuths,
            radius,
            _KINDS[kind],
            step_s,
            marks,
            commands,
            forces @ turn,
            state,
            rope,
            states,
            tensions,
        )
        if verdict != layout.FINE:
            raise SimulationError(verdict, segment + 1, time)
        polar = states[..., :3].copy()
        polar[:, 0, 1] += plane
        flags = np.zeros((len(marks), p.segments, 2))
        return chain_coordinates(polar), states[..., 3:6], tensions, flags, steps

    return run


def _first_plane(chain: Chain, kind: CommandKind, commands: Floats, forces: Floats) -> float:
    """Direction [rad] in which the robot bends at first: that of its posture, else of the cables' first moment, else of the
    first force across."""
    q = chain.q
    if np.hypot(q[0, 0], q[0, 1]) > 0.0:
        return float(polar_coordinates(q)[0, 1])
    sides = chain.parameters.cable_matrix[:, :2] * (1.0 if kind == "lengths" else -1.0)
    for pushes in (commands.reshape(-1, commands.shape[-1]) @ sides, forces[..., :2].sum(axis=2).reshape(-1, 2)):
        sizes = np.hypot(pushes[:, 0], pushes[:, 1])
        if sizes.max() > 0.0:
            x, y = pushes[np.argmax(sizes > 1e-9 * sizes.max())]
            return float(np.arctan2(y, x))
    return 0.0


def _marks(duration_s: float, record_s: float, schedules: Sequence[Schedule]) -> Floats:
    """Times to record: a regular grid and every time at which an input jumps or bends, so that no step straddles one."""
    grid = np.append(np.arange(0.0, duration_s - 1e-9, record_s), duration_s)
    corners = np.concatenate([schedule.time_s for schedule in schedules])
    marks = np.sort(np.concatenate([grid, corners[(corners > 0.0) & (corners < duration_s)]]))
    return marks[np.append(True, np.diff(marks) > layout.SMALLEST_STEP_S)]


def _check(n: int, k: int, cables: Cables, loads: Sequence[Load], sizes: dict[str, float]) -> None:
    for name, value in sizes.items():
        if not (np.isfinite(value) and value > 0.0):
            raise ValueError(f"{name} = {value:g}: must be positive")
    if sizes["step_s"] < SMALLEST_STEP_S:
        raise ValueError(f"step_s = {sizes['step_s']:g}: must be at least {SMALLEST_STEP_S:g}")
    if len(cables.schedules) != k:
        raise ValueError(f"{len(cables.schedules)} cable {cables.kind} for {k} cables")
    for j, schedule in enumerate(cables.schedules):
        if schedule.values.ndim != 1:
            raise ValueError(f"the {cables.kind} of cable {j + 1} must be one number for each time")
        if min(schedule.values.min(), schedule.before) < 0.0:
            raise ValueError(f"a negative value among the {cables.kind} of cable {j + 1}: a cable can only pull")
        if cables.kind == "lengths" and schedule.time_s[0] > 0.0 and schedule.before == 0.0:
            raise ValueError(f"the length of cable {j + 1} must be given from 0 s on")
    for load in loads:
        if not 1 <= load.guider <= n:
            raise ValueError(f"there is no guider {load.guider}; they are numbered 1 (base) to {n} (top)")
        if load.force.values.shape[1:] != (3,):
            raise ValueError(f"the force on guider {load.guider} must have three components, x, y and z of the base")
