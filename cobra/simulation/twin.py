"""The physics twin: a robot's description as a MuJoCo chain, moved by the travel of its drives."""

import dataclasses
import math
import threading

import mujoco
import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.ramps import approached
from cobra.simulation.cables import Cables
from cobra.simulation.chain import Chain, build_chain
from cobra.simulation.chain_parts import PASSIVE, SETTLING_S, STEP_DAMPING_S, STEP_S, YIELD_RATIO, Kind
from cobra.simulation.contacts import NO_CONTACTS, pressing
from cobra.simulation.environments import Environment
from cobra.simulation.plant import Floats, Truth
from cobra.simulation.slots import Slots

BENDS = ("bend_x", "bend_y")
_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS | mujoco.mjtState.mjSTATE_XFRC_APPLIED
DIVERGED_SPEED = 1e4
"""Joint speeds [rad/s] beyond this are no motion of a robot."""
HAND_SPEED_M_S = 0.05
"""With which a hand feeds at most."""
HELD_FRACTION = 5e-4
"""Of a joint behind the port: its stretch bends as if only this fraction of it could."""


class Twin:
    """A `Plant`: `advance` from one thread, `truth` from any."""

    def __init__(self, description: RobotDescription, chain: Chain, environment: Environment | None = None) -> None:
        self.description = description
        self.environment = environment
        self.chain = chain
        self.data = mujoco.MjData(chain.model)
        self.recoveries = 0
        """How often a bad state (not finite, or diverged) was replaced by the last good one."""
        self._lock = threading.Lock()
        d = description
        self._tendons = np.array(d.tendon_drives, dtype=np.intp)
        self._offset = np.zeros(len(d.drives))
        self._offset[self._tendons] = chain.tendon_rest
        self._cables = Cables(d, d.tendon, chain) if chain.pieces is not None and d.tendon else None
        self._single = chain.drive_actuators >= 0
        """Drives that have one actuator; the others' tendons rub and are pulled piece by piece."""
        self._actuators = chain.drive_actuators[self._single]
        springs = chain.springs
        self._start = np.array([spring.start_m for spring in springs])
        self._span = np.array([spring.end_m - spring.start_m for spring in springs])
        self._stiffness = np.array([spring.stiffness for spring in springs])
        self._bend_sums = np.zeros((2 * len(d.sections), chain.model.nq))
        for spring, joint in zip(springs, chain.joints, strict=True):
            if spring.does in BENDS and spring.section != PASSIVE:
                self._bend_sums[2 * spring.section + BENDS.index(spring.does), joint] = 1.0
        self._slots = Slots(d, chain) if any(section.elongation for section in d.sections) else None
        self._hand_m = self._hand_goal_m = d.active_length_m
        """Exposed length at which the hand holds the robot, and to which it feeds it."""
        self._travel: Floats | None = None
        self._feed_m = math.nan
        self._state = np.zeros(mujoco.mj_stateSize(chain.model, _STATE))
        self._loads = np.zeros(len(d.drives))
        self._contacts = NO_CONTACTS
        mujoco.mj_forward(chain.model, self.data)
        self._truth = self._observe()

    def advance(self, travel: Floats, duration_s: float) -> Floats:
        """Move the drives' ends evenly to `travel` within `duration_s`; see `Plant.advance`.

        The first call tells where the drives stand: there is nothing to move from, so the base is put there.

        Raises:
            ValueError: `travel` is not one finite number a drive, or `duration_s` not finite and ≥ 0.
        """
        target = np.asarray(travel, dtype=np.float64)
        if target.shape != self._offset.shape or not np.isfinite(target).all():
            raise ValueError(f"travel = {travel}: must be {self._offset.size} finite numbers, one a drive")
        if not (math.isfinite(duration_s) and duration_s >= 0):
            raise ValueError(f"duration_s = {duration_s}: must be finite and not negative")
        with self._lock:
            if self._travel is None:
                self._place(target)
            hand_m = approached(self._hand_m, self._hand_goal_m, HAND_SPEED_M_S * duration_s)
            self._run(self._travel if self._travel is not None else target, target, hand_m, duration_s)
            self._travel, self._hand_m = target.copy(), hand_m
            self._truth = self._observe()
            return self._loads.copy()

    def truth(self) -> Truth:
        """The state after the last `advance`; the clearance is measured now, by who asks."""
        truth = self._truth
        if self.environment is None:
            return truth
        radius = self.description.backbone.diameter_m / 2
        axis = truth.vertebrae.copy()
        # The tip is round: its skin ends where the axis does.
        w, x, y, z = truth.tip_wxyz
        axis[-1] -= radius * np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])
        beyond = axis[axis[:, 2] > 0.0]
        if not len(beyond):
            return truth
        distances, places = self.environment.distance(beyond)
        nearest = int(np.argmin(distances))
        return dataclasses.replace(
            truth,
            clearance_m=float(distances[nearest]) - radius,
            clearance_points=np.stack([beyond[nearest], places[nearest]]),
        )

    def push(self, vertebra: int, force: Floats, torque: Floats | None = None) -> None:
        """From now on push at a vertebra's centre: `force` (3,) [N], `torque` (3,) [N·m], in the frame of the port.

        `vertebra` counts as in `Truth.vertebrae`; -1 is the tip.
        """
        with self._lock:
            wrench = self.data.xfrc_applied[self.chain.vertebra_bodies[vertebra]]
            wrench[:3] = force
            wrench[3:] = 0.0 if torque is None else torque

    def feed_by_hand(self, length_m: float) -> None:
        """See `Plant.feed_by_hand`; the hand needs its time."""
        if self.chain.hand_actuator < 0:
            raise ValueError(f"{self.description.name} is not fed by hand")
        self._hand_goal_m = min(max(length_m, 0.0), self.chain.longest_m)

    def break_tendon(self, name: str) -> None:
        """From now on this tendon carries nothing.

        Raises:
            ValueError: there is no such tendon; so for `jam` and `slip`.
        """
        index = self._index(name)
        with self._lock:
            if self._cables is not None:
                self._cables.break_tendon(index)
            else:
                actuator = self.chain.drive_actuators[self._tendons[index]]
                self.chain.model.actuator_gainprm[actuator] = self.chain.model.actuator_biasprm[actuator] = 0.0

    def jam(self, name: str) -> None:
        """From now on this tendon is stuck at the port, whatever its drive does."""
        index = self._index(name)
        with self._lock:
            if self._cables is None:
                raise ValueError(f"tendon {name} cannot jam: this twin has no friction")
            self._cables.jam(index)

    def slip(self, name: str, length_m: float) -> None:
        """Let this tendon slip on its spool by `length_m` [m], once; positive is paid out."""
        index = self._index(name)
        with self._lock:
            if self._cables is not None:
                self._cables.slip(index, length_m)
            else:
                self._offset[self._tendons[index]] += length_m

    def _index(self, name: str) -> int:
        names = self.description.tendon_names
        if name not in names:
            raise ValueError(f"no tendon {name!r}; there are {', '.join(names)}")
        return names.index(name)

    def _place(self, travel: Floats) -> None:
        d, data = self.description, self.data
        if d.feed_drive is not None or d.hand_fed:
            exposed_m = self._hand_m if d.feed_drive is None else float(travel[d.feed_drive])
            data.joint("feed").qpos[0] = exposed_m
            self._expose(exposed_m)
        if d.twist_drive is not None:
            data.joint("twist").qpos[0] = travel[d.twist_drive]
        mujoco.mj_forward(self.chain.model, data)
        self._remember()

    def _run(self, start: Floats, end: Floats, hand_end_m: float, duration_s: float) -> None:
        """Integrate; a bad state on the way ends in the last good one, at rest."""
        model, data, hand = self.chain.model, self.data, self.chain.hand_actuator
        feed = self.description.feed_drive
        fed_m, fed_end_m = (self._hand_m, hand_end_m) if feed is None else (float(start[feed]), float(end[feed]))
        steps = math.ceil(duration_s / STEP_S - 1e-9)
        step_s = duration_s / steps if steps else STEP_S
        speed = (end - start) / duration_s if steps else np.zeros_like(start)
        feed_speed = (fed_end_m - fed_m) / duration_s if steps else 0.0
        model.opt.timestep = step_s
        good = True
        for k in range(steps):
            # The force of a step belongs to its start; its damping is against the drive's own speed.
            ahead = self._offset + start + (k * step_s + STEP_DAMPING_S) * speed
            data.ctrl[self._actuators] = ahead[self._single]
            if hand >= 0:
                data.ctrl[hand] = fed_m + (k * step_s + STEP_DAMPING_S) * feed_speed
            if self._cables is not None:
                self._cables.step(data, (start + k * step_s * speed)[self._tendons])
            mujoco.mj_step2(model, data)
            if self.environment is not None and k == steps - 1:
                self._contacts = pressing(data)
            good = bool(data.qvel @ data.qvel < DIVERGED_SPEED**2)  # False for NaN too
            if not good:
                break
            if feed is not None or hand >= 0:
                self._expose(fed_m + (k + 1) * step_s * feed_speed)
            if self._slots is not None:
                self._slots.update(model, data)
            mujoco.mj_step1(model, data)
        if good:
            self._remember()
        else:
            self._recover()
        self._loads = self._drive_loads(end, speed)

    def _remember(self) -> None:
        mujoco.mj_getState(self.chain.model, self.data, self._state, _STATE)
        if self._cables is not None:
            self._memory = self._cables.memory()

    def _recover(self) -> None:
        self.recoveries += 1
        time_s = self.data.time
        mujoco.mj_resetData(self.chain.model, self.data)
        mujoco.mj_setState(self.chain.model, self.data, self._state, _STATE)
        self.data.time = time_s
        self.data.qvel[:] = 0.0
        if self._cables is not None:
            self._cables.restore(self._memory)
        mujoco.mj_forward(self.chain.model, self.data)

    def _expose(self, feed_m: float) -> None:
        """Stiffen what lies behind the port: a joint bends over the exposed part of its stretch only."""
        if feed_m == self._feed_m:
            return
        self._feed_m = feed_m
        ahead = self._start + self._span + feed_m - self.description.active_length_m
        stiffness = self._stiffness / np.clip(ahead / self._span, HELD_FRACTION, 1.0)
        model = self.chain.model
        model.jnt_stiffness[self.chain.joints] = stiffness
        model.dof_damping[self.chain.joints] = SETTLING_S * self._stiffness + STEP_DAMPING_S * stiffness

    def _drive_loads(self, travel: Floats, speed: Floats) -> Floats:
        """Force of each drive on its part; of a tendon the tension, k (l − l_free) with its damping, never below zero."""
        model, data, own = self.chain.model, self.data, self._actuators
        error = self._offset + travel
        error[self._single] -= data.actuator_length[own]
        moving = speed.copy()
        moving[self._single] -= data.actuator_velocity[own]
        force = np.zeros_like(travel)
        force[self._single] = model.actuator_gainprm[own, 0] * (error + STEP_DAMPING_S * moving)[self._single]
        strongest = YIELD_RATIO * self.description.tendon.max_tension_N if self.description.tendon else 0.0
        pulled = -force[self._tendons] if self._cables is None else self._cables.motor_tension
        force[self._tendons] = np.clip(pulled, 0.0, strongest)
        return force

    def _observe(self) -> Truth:
        chain, data = self.chain, self.data
        tip_wxyz = np.empty(4)
        mujoco.mju_mat2Quat(tip_wxyz, data.site_xmat[chain.tip_site])
        return Truth(
            time_s=float(data.time),
            tip_position=data.site_xpos[chain.tip_site].copy(),
            tip_wxyz=tip_wxyz,
            vertebrae=data.site_xpos[chain.vertebra_sites],
            bends=(self._bend_sums @ data.qpos).reshape(-1, 2),
            tensions=self._loads[self._tendons],
            tension_profile=self._profile(),
            locked=tuple(self._slots.caught.tolist()) if self._slots else (),
            passive=data.site_xpos[chain.passive_sites],
            contact_points=self._contacts.points,
            contact_forces=self._contacts.forces,
        )

    def _profile(self) -> Floats:
        if self._cables is not None:
            return self._cables.profile
        d = self.description
        ends = np.arange(len(d.sections)) <= np.array(d.tendon_section, dtype=np.intp).reshape(-1, 1)
        known = np.concatenate([np.ones((len(ends), 2), dtype=np.bool_), ends], axis=1)
        return np.where(known, self._loads[self._tendons][:, None], np.nan)


def build_twin(
    description: RobotDescription,
    kind: Kind = "default",
    payload_kg: float = 0.0,
    environment: Environment | None = None,
) -> Twin:
    """The twin of a robot: "default" with the description's tendons and gravity, "ideal" with stiff tendons, weightless.

    Args:
        payload_kg: carried by the tip, a point mass.
        environment: walls that it touches; None is free space.
    """
    return Twin(description, build_chain(description, kind, payload_kg, environment), environment)
