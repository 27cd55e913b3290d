"""Drives a robot through the guided sweep as any driver would, hold-to-run, and says which losses explain what its drives felt."""

import math
import threading
import time
from pathlib import Path

import msgspec
import numpy as np

from app.console.robot_keeper import RobotKeeper
from app.link.console_end import ConsoleLink
from cobra.control.identification_sweep import Step, steps
from cobra.control.tendon_control import fits
from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.loading import load_description
from cobra.mechanics.loss_identification import EACH, NAMES, Sweep, identify
from cobra.mechanics.losses import Identified, Losses, to_text
from cobra.messages import Command, Intent, Reply, Request, RobotState

PERIOD_S = 0.02
ATTEMPTS = 4
LET_GO_S = 0.6
RETAIN_S = 0.3
HOMING_S = 60.0
UNITS = {
    "axial_stiffness_N": ("tendon stiffness EA", "N", 1.0),
    "drive_friction_N": ("gear friction, as tension", "N", 1.0),
    "backlash_m": ("play of the drives, as travel", "mm", 1e3),
    "hole_friction": ("friction in the vertebrae, mu", "", 1.0),
    "conduit_capstan": ("friction of the conduit, mu times its bends", "", 1.0),
    "settling_s": ("time in which a section straightens", "s", 1.0),
    "radius_m": ("routing radius", "mm", 1e3),
    "bending_stiffness_Nm2": ("bending stiffness EI", "N m2", 1.0),
}


class IdentifyError(OperatorError):
    """The sweep cannot be made or was ended. The message says why and what to do."""


def identify_friction(robot: str, out: Path | None, apply: bool, options: tuple[str, ...]) -> int:
    """Sweep the running robot process of this robot, or one started for it, and report. Returns the exit status.

    Raises:
        IdentifyError, SweepError, DescriptionError: with one clear line.
    """
    description = load_description(robot)
    if not fits(description):
        raise IdentifyError(f"{description.name}: has no tendons on sections of constant length; nothing to identify")
    keeper = RobotKeeper(robot, description.name, options)
    keeper.launch()
    try:
        endpoint = keeper.wait()
        print(f"{'sweeping the running' if keeper.adopted else 'started a'} robot process of {description.name}")
        link = ConsoleLink(description.name, endpoint)
        link.start()
        try:
            driver = _Driver(link)
            states = driver.sweep(list(steps(description)))
            identified = identify(
                description, _as_sweep(states, description.tendon_drives), f"a guided sweep, {_today()}"
            )
            for line in report(description, identified):
                print(line)
            if out is not None:
                out.write_text(to_text(identified), "utf-8")
                print(f'written to {out}; name it in the description: [compensation] parameters = "{out}"')
            if apply and keeper.adopted:
                reply = driver.ask(Request(what="parameters", name=to_text(identified)))
                print("in use from the next homing on" if reply.ok else f"not taken over: {'; '.join(reply.reasons)}")
            driver.leave()
        finally:
            link.stop()
    finally:
        if not keeper.adopted:
            keeper.end()
    return 0


def report(description: RobotDescription, identified: Identified) -> list[str]:
    """A table: each parameter, found ± its standard deviation, and what the description says."""
    nominal = Losses.described(description)
    lines = [f"{'':46}{'found':>12} {'±':>10}   described"]

    def line(name: str, which: slice, suffix: str = "") -> None:
        words, unit, scale = UNITS[name]
        found, sigma, said = (
            float(np.mean(np.atleast_1d(getattr(part, name))[which])) * scale
            for part in (identified.losses, identified.deviation, nominal)
        )
        lines.append(f"{words + suffix:46}{found:12.4g} {sigma:10.2g}   {said:.4g} {unit}".rstrip())

    for name in NAMES:
        line(name, slice(None))
    for name in EACH:
        for k in description.active_sections:
            line(name, slice(k, k + 1), f", section {description.sections[k].name}")
    return lines


class _Driver:
    """Takes the controls, arms, and holds the dead-man step by step. Ctrl-C lets go, and the robot stands."""

    def __init__(self, link: ConsoleLink) -> None:
        self._link = link
        self._sequence = 0
        state = link.wait_for_state(10.0)
        if state.lease.holder and state.lease.fresh:
            raise IdentifyError(f"{state.lease.holder} drives: let them release the controls first")
        reply = link.request(Request(what="acquire", who="identify friction"))
        if not reply.ok:
            raise IdentifyError(f"the controls cannot be taken: {'; '.join(reply.reasons)}")
        self._lease, self._epoch = reply.lease, reply.epoch
        self._left = threading.Event()
        threading.Thread(target=self._retain, name="lease", daemon=True).start()
        self._states: list[RobotState] = []

    def ask(self, request: Request) -> Reply:
        return self._link.request(msgspec.structs.replace(request, lease=self._lease))

    def sweep(self, plan: list[Step]) -> list[RobotState]:
        """All states of the sweep, from homing on."""
        self._run(Step(0.3, None))
        self._arm()
        self._must(Request(what="compensation", value=0.0))
        try:
            self._link.on_state = self._states.append
            seconds = sum(step.seconds for step in plan)
            print(f"sweeping for {seconds:.0f} s; Ctrl-C stops it, and the robot stands")
            for step in plan:
                if step.pretension_N is not None:
                    self._must(Request(what="pretension", value=step.pretension_N))
                self._repeat(step)
        finally:
            self._link.on_state = lambda state: None
            self.ask(Request(what="compensation", value=1.0))
        return self._states

    def leave(self) -> None:
        """Give the controls back."""
        self._left.set()
        self.ask(Request(what="release"))

    def _repeat(self, step: Step) -> None:
        """A machine that stalled ends the drive; let go and press again, as a person would."""
        for attempt in range(ATTEMPTS):
            try:
                return self._run(step)
            except IdentifyError:
                if attempt == ATTEMPTS - 1 or self._link.wait_for_state(1.0).phase in ("stopped", "fault", "disarmed"):
                    raise
                self._run(Step(LET_GO_S, None))
        return None

    def _retain(self) -> None:
        """Beside the commands: an answer may take its time, a command must not."""
        while not self._left.wait(RETAIN_S):
            self._link.request(Request(what="retain", lease=self._lease))

    def _arm(self) -> None:
        state = self._link.wait_for_state(1.0)
        what = "arm" if state.phase in ("disarmed", "fault") else "home"
        self._must(Request(what=what))
        deadline = time.monotonic() + HOMING_S
        while (state := self._link.wait_for_state(1.0)).phase != "ready" or not state.homed:
            if state.phase in ("stopped", "fault", "holding") or time.monotonic() > deadline:
                raise IdentifyError(f"homing did not end well: {state.cause or state.phase}")
            self._run(Step(PERIOD_S, None))

    def _must(self, request: Request) -> None:
        deadline = time.monotonic() + HOMING_S
        while not (reply := self.ask(request)).ok:
            if request.what != "arm" or time.monotonic() > deadline:
                raise IdentifyError(f"{request.what} is refused: {'; '.join(reply.reasons)}")
            self._run(Step(0.2, None))

    def _run(self, step: Step) -> None:
        """Send the step's command over and over; a robot that does not follow any more ends it."""
        held = step.intent is not None
        for tick in range(max(1, math.ceil(step.seconds / PERIOD_S))):
            state = self._link.wait_for_state(1.0)
            self._sequence += 1
            self._link.send(
                Command(
                    lease=self._lease,
                    epoch=self._epoch,
                    sequence=self._sequence,
                    echo=state.stamp,
                    held=held,
                    intent=step.intent or Intent(),
                )
            )
            if held and tick > 25 and state.phase != "driving":
                raise IdentifyError(f"the sweep was ended: {state.cause or state.phase}")
            time.sleep(PERIOD_S)


def _as_sweep(states: list[RobotState], drives: tuple[int, ...]) -> Sweep:
    own = list(drives)
    rows = [state.drives for state in states]
    return Sweep(
        time_s=np.array([state.stamp for state in states]),
        travel=np.array([row.travel for row in rows])[:, own],
        velocity=np.array([row.velocity for row in rows])[:, own],
        load=np.array([row.load for row in rows])[:, own],
    )


def _today() -> str:
    return time.strftime("%Y-%m-%d")
