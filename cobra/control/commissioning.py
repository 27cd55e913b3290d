"""Commissioning through the robot process: a driver asks for one step at a time, the loop carries it out, STOP always works.

A step begins on standing drives, moves them as its procedure says, and ends done, or held with the reason. The calibration that
it gives is kept by a thread of its own; the newest one is in use from the start.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np

from cobra.control.drivetrain import Drivetrain
from cobra.control.requests import Act
from cobra.control.supervisor import Health
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.messages import Commissioned, CommissioningReport, Reply, Request
from cobra.motors.bus import HOME_AGAIN
from cobra.motors.calibration import Calibration, CalibrationBook, CalibrationError, zero_angles, zeros
from cobra.motors.cell_readings import LoadCells
from cobra.motors.commissioning.bench import Bounded
from cobra.motors.commissioning.cell_points import KnownForce, Tare
from cobra.motors.commissioning.drive_test import DriveTest
from cobra.motors.commissioning.identify import Wiggle
from cobra.motors.commissioning.procedure import AbortError, Floats, Guard, seen_of
from cobra.motors.commissioning.repeat import MOST_RUNS, RepeatedHoming

Begin = Callable[[Health, float], tuple[str, ...]]
"""Makes the drives stand ready for a step: (health, now [s]) → what prevents it, in words."""

SAME_COUNT_M: Final = 0.02
"""A drive whose zero went further counts from elsewhere: it has lost power."""
ALONE_M: Final = 1e-3
NO_SHAPE_M: Final = 2e-3
"""Friction and stretch explain less; of a motor's turn, 7 mm on a spool of 10 mm, at least half is left over."""
GOOD_SPREAD_M: Final = 5e-4
"""Zeros that differ by more from run to run are told of."""


class Commissioning:
    """At most one step at a time; `report` says what it does and what the last ones found."""

    def __init__(
        self,
        description: RobotDescription,
        drivetrain: Drivetrain,
        cells: LoadCells,
        book: CalibrationBook,
        begin: Begin,
        refer: Callable[[Floats, Floats], Reply],
        warn: Callable[[str], None],
    ) -> None:
        self._description = description
        self._drivetrain = drivetrain
        self._cells = cells
        self._book = book
        self._begin = begin
        self._refer = refer
        self._warn = warn
        self._procedure: Bounded | None = None
        self._guard: Guard | None = None
        self._queue: list[Bounded] = []
        self._step = self._outcome = self._words = ""
        self._found: tuple[Commissioned, ...] = ()
        self._writer = ThreadPoolExecutor(1, thread_name_prefix="calibration")

    @property
    def acts(self) -> dict[str, Act]:
        """What may be asked of the driver's hand."""
        return {
            "identify": self._identify,
            "test": self._test,
            "home_repeatedly": self._home,
            "tare": self._tare,
            "calibrate_cell": self._known_force,
            "abort": self._abort,
            "resume": self._resume,
        }

    @property
    def homes(self) -> bool:
        """Whether the step that runs finds the drives' zeros."""
        return isinstance(self._procedure, RepeatedHoming)

    @property
    def loosens(self) -> bool:
        """Whether the step that runs leaves tendons slack."""
        return isinstance(self._procedure, Tare)

    @property
    def kept(self) -> Calibration | None:
        """The calibration in use; None before any."""
        return self._book.newest

    def start(self) -> None:
        """Take the newest calibration into use."""
        kept = self._book.load()
        for complaint in self._book.complaints:
            self._warn(complaint)
        if kept is not None:
            self._cells.calibrate(kept.cells)

    def stop(self) -> None:
        """Wait until what was found is written."""
        self._writer.shutdown()

    # ------------------------------------------------------------------ the tick

    def advance(self, setpoint: Floats, dt_s: float) -> Floats:
        """The next travel setpoint (drives,); `done` or `failed` says when the step is over."""
        drivetrain, procedure, guard = self._drivetrain, self._procedure, self._guard
        if procedure is None or guard is None or drivetrain.feedback is None:
            return setpoint
        seen = seen_of(drivetrain.feedback, drivetrain.transmission)
        try:
            guard.check(setpoint, seen, dt_s)
            target = procedure.step(setpoint, seen, dt_s)
        except AbortError as error:
            self.end(str(error))
            return setpoint
        if procedure.done:
            self._take(procedure)
            if self._queue:
                self._procedure = self._queue.pop(0)
                self._guard = Guard(self._description, self._procedure.moved, self._procedure.bounds)
            else:
                self._outcome = "done"
        return target

    @property
    def running(self) -> bool:
        return self._outcome == "running"

    @property
    def done(self) -> bool:
        return self._outcome == "done" and self._procedure is not None

    @property
    def failed(self) -> str:
        """Why the step was ended, in words, until somebody has taken note of it."""
        return self._words if self._outcome == "ended" and self._procedure is not None else ""

    def forget(self) -> None:
        """The end of the step is taken note of; its findings stay."""
        self._procedure = self._guard = None
        self._queue = []

    def end(self, why: str) -> None:
        """It cannot go on."""
        if self.running:
            self._outcome, self._words = "ended", why

    def homed(self, setpoint: Floats) -> None:
        """The zeros are those at this setpoint of travel (drives,), which the drives were just referred to."""
        procedure = self._procedure
        assert isinstance(procedure, RepeatedHoming)
        spread = dict(zip(self._description.tendon_names, procedure.spread_m.tolist(), strict=True))
        drives = self._description.drives
        by_drive = {
            drives[index].name: spread[name]
            for name, index in zip(self._description.tendon_names, self._description.tendon_drives, strict=True)
        }
        angle = self._drivetrain.transmission.angle(setpoint)
        runs = len(procedure.travels)
        found = zeros(self._description, angle, setpoint, by_drive if runs > 1 else None)
        self._keep(lambda: self._book.keep(f"homed {runs} times in the page", drives=found))
        if runs > 1:
            self._found = tuple(
                Commissioned(
                    drive=name,
                    check="spread",
                    ok=value <= GOOD_SPREAD_M,
                    words=f"{value * 1e3:.2f} mm over {runs} runs",
                )
                for name, value in spread.items()
            )

    def compare(self) -> None:
        """Warn of tendons whose zero homing has just found elsewhere than what is kept, alone among the others.

        Drives that have lost power since count from elsewhere altogether: of them nothing can be said.
        """
        kept, feedback = self._book.newest, self._drivetrain.feedback
        if kept is None or not kept.drives or feedback is None or not len(self._drivetrain.tendon_index):
            return
        zero, why = zero_angles(self._description, kept)
        if why:
            return
        index = self._drivetrain.tendon_index
        now = self._drivetrain.transmission.angle(np.zeros(len(zero)))
        moved = ((now - zero) * self._drivetrain.transmission.travel_per_rad)[index]
        alone = moved - np.median(moved)
        if np.abs(moved).max() > SAME_COUNT_M:
            return
        for i in np.flatnonzero(np.abs(alone) > ALONE_M):
            self._warn(
                f"tendon {self._description.tendon_names[i]}: its zero is {abs(alone[i]) * 1e3:.1f} mm off what was kept on "
                f"{kept.date}: was it replaced, or did it slip?"
            )

    def _resume(self, request: Request, now_s: float, health: Health) -> Reply:
        """Take the kept zeros instead of homing, where the drives have had power since and the robot must not be moved.

        The tendons outnumber the bends: lengths that no shape has show drives that lost their count.
        """
        kept, feedback = self._book.newest, self._drivetrain.feedback
        if kept is None or feedback is None:
            return Reply(ok=False, reasons=("there are no kept zeros: home it",))
        zero, why = zero_angles(self._description, kept)
        travel = (feedback.angle - zero) * self._drivetrain.transmission.travel_per_rad
        if not why:
            why = self._doubt(travel, kept.date)
        lost = [fault for fault in health.faults if HOME_AGAIN in fault]
        why = "; ".join((*health.blocking, *lost)) or why
        return Reply(ok=False, reasons=(why,)) if why else self._refer(feedback.angle, travel)

    def _doubt(self, travel: Floats, date: str) -> str:
        """Why a travel (drives,) cannot be what the kept zeros say, in words; empty if it can."""
        for drive, here in zip(self._description.drives, travel.tolist(), strict=True):
            low, high = drive.travel_limits
            if not low <= here <= high:
                return f"drive {drive.name} would be out of its travel: it lost its count since {date}; home it"
        drivetrain = self._drivetrain
        shape = drivetrain.tendons.shape(travel[drivetrain.tendon_index], Configuration(self._description).rest())
        # Tension that all have lost alike, when the drives were switched off, is no lost count.
        off = np.abs(shape.residual_m - np.median(shape.residual_m))
        if len(off) and off.max() > NO_SHAPE_M:
            name = self._description.tendon_names[int(np.argmax(off))]
            return (
                f"tendon {name} would be {off.max() * 1e3:.1f} mm off any shape: its drive lost its count since {date}, or it "
                "slipped; home it"
            )
        return ""

    def report(self) -> CommissioningReport:
        """For everybody to see."""
        kept = self._book.newest
        if kept is None and not self._step:
            return NOTHING
        return CommissioningReport(
            step=self._step,
            doing=self._procedure.progress if self.running and self._procedure else "",
            outcome=self._outcome,
            words=self._words,
            found=self._found,
            calibration=f"version {kept.version}, {kept.date}: {kept.by}" if kept else "",
        )

    # ------------------------------------------------------------------ what is asked

    def _identify(self, request: Request, now_s: float, health: Health) -> Reply:
        return self._run(request, now_s, health, lambda i: [Wiggle(self._description, i)], one=True)

    def _test(self, request: Request, now_s: float, health: Health) -> Reply:
        return self._run(request, now_s, health, lambda i: [DriveTest(self._description, i)], one=False)

    def _run(
        self, request: Request, now_s: float, health: Health, make: Callable[[int], list[Bounded]], *, one: bool
    ) -> Reply:
        names = [drive.name for drive in self._description.drives]
        if request.name not in names and (one or request.name):
            return Reply(ok=False, reasons=(f"there is no drive {request.name!r}; there are {', '.join(names)}",))
        chosen = [names.index(request.name)] if request.name else range(len(names))
        return self._start(request.what, now_s, health, lambda: [step for i in chosen for step in make(i)])

    def _home(self, request: Request, now_s: float, health: Health) -> Reply:
        runs = int(request.value)
        if not 1 <= runs <= MOST_RUNS:
            return Reply(ok=False, reasons=(f"{request.value:g} runs: must be 1 to {MOST_RUNS}",))
        bending = self._drivetrain.tendons.bending
        return self._start(request.what, now_s, health, lambda: [RepeatedHoming(self._description, bending, runs)])

    def _tare(self, request: Request, now_s: float, health: Health) -> Reply:
        tendons = (request.name,) if request.name else ()
        return self._start(request.what, now_s, health, lambda: [Tare(self._description, tendons)])

    def _known_force(self, request: Request, now_s: float, health: Health) -> Reply:
        kept = self._book.newest
        tare = kept.cells.get(request.name) if kept else None
        return self._start(
            request.what, now_s, health, lambda: [KnownForce(self._description, request.name, request.value, tare)]
        )

    def _abort(self, request: Request, now_s: float, health: Health) -> Reply:
        if not self.running:
            return Reply(ok=False, reasons=("nothing runs that could be ended",))
        self.end("it was ended by the driver")
        return Reply(ok=True)

    def _start(self, what: str, now_s: float, health: Health, make: Callable[[], list[Bounded]]) -> Reply:
        if self.running:
            return Reply(ok=False, reasons=("a step of commissioning runs: wait, or end it",))
        try:
            steps = make()
        except AbortError as error:
            return Reply(ok=False, reasons=(str(error),))
        reasons = self._begin(health, now_s)
        if reasons:
            return Reply(ok=False, reasons=reasons)
        self._procedure, *self._queue = steps
        self._guard = Guard(self._description, self._procedure.moved, self._procedure.bounds)
        self._step, self._outcome, self._words, self._found = what, "running", "", ()
        return Reply(ok=True)

    # ------------------------------------------------------------------ what was found

    def _take(self, procedure: Bounded) -> None:
        match procedure:
            case DriveTest():
                self._found += tuple(
                    Commissioned(drive=procedure.name, check=check.name, ok=check.ok, words=check.words)
                    for check in procedure.checks
                )
            case Wiggle():
                words = f"{procedure.moved_degrees:.1f} degrees by its own encoder, up to {procedure.largest_A:.2f} A"
                self._found = (
                    Commissioned(drive=procedure.name, check="moved", ok=procedure.moved_degrees > 1.0, words=words),
                )
            case Tare() | KnownForce():
                self._found = tuple(
                    Commissioned(
                        drive=name, check="load cell", ok=True, words=f"offset {c.offset_N:+.3f} N, gain {c.gain:.4f}"
                    )
                    for name, c in procedure.cells.items()
                )
                found = procedure.cells
                by = "tared in the page" if isinstance(procedure, Tare) else "calibrated with a known force in the page"
                before = self._book.newest
                self._cells.calibrate({**(before.cells if before else {}), **found})
                self._keep(lambda: self._book.keep(by, cells=found))

    def _keep(self, write: Callable[[], object]) -> None:
        """A disk may take its time; the loop may not."""

        def writing() -> None:
            try:
                write()
            except CalibrationError as error:
                self._warn(str(error))

        self._writer.submit(writing)


NOTHING: Final = CommissioningReport()
