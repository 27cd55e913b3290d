"""Commissioning through the control loop: what a driver may ask, what then moves, and what ends it."""

from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.control.loop import RobotLoop
from cobra.description import LoadCell
from cobra.loading import load_description
from cobra.messages import Intent, Request, RobotState, Stop, encode
from cobra.motors.calibration import CalibrationBook
from cobra.simulation.drives import world_of
from cobra.simulation.faults import FaultDesk
from tests.bench import CHANNEL, Bench

COBRA = load_description("cobra")
CELLS = tuple(
    LoadCell(tendon=name, bus="main", frame_id=0x300 + i, scale_N=0.01, rate_Hz=50.0, noise_N=0.02, bias_N=0.5)
    for i, name in enumerate(COBRA.tendon_names)
)


def ask(bench: Bench, what: str, name: str = "", value: float = 0.0) -> tuple[bool, tuple[str, ...]]:
    reply = bench.ask(Request(what=what, lease=bench.lease, name=name, value=value))
    return reply.ok, reply.reasons


def attend(bench: Bench, ticks: int = 5) -> RobotState:
    for _ in range(ticks):
        state = bench.tick()
    return state


def until_over(bench: Bench, seconds: float = 40.0) -> RobotState:
    for _ in range(round(seconds / bench.loop.period_s)):
        state = bench.tick()
        if state.commissioning.outcome != "running":
            break
    return attend(bench)


def test_one_drive_is_moved_and_is_off_again() -> None:
    with Bench(0, "none") as bench:
        attend(bench)
        before = world_of(CHANNEL).travel.copy()
        assert ask(bench, "identify", "E2") == (True, ())
        state = bench.tick()
        assert (state.phase, state.commissioning.step) == ("commissioning", "identify")
        assert "E2 moves to and fro" in state.commissioning.doing
        largest = np.zeros(14)
        while bench.tick().phase == "commissioning":
            largest = np.maximum(largest, np.abs(world_of(CHANNEL).travel - before))
        state = attend(bench)
        index = [drive.name for drive in COBRA.drives].index("E2")
        assert largest[index] == pytest.approx(np.radians(5.0) * 0.01, rel=0.1)
        assert np.delete(largest, index).max() < 2e-5
        assert (state.phase, state.commissioning.outcome) == ("disarmed", "done")
        (found,) = state.commissioning.found
        assert (found.drive, found.ok) == ("E2", True)


@pytest.mark.parametrize(
    ("what", "name", "value", "words"),
    [
        ("identify", "S9", 0.0, "there is no drive 'S9'"),
        ("home_repeatedly", "", 0.0, "must be 1 to 10"),
        ("home_repeatedly", "", 1e9, "must be 1 to 10"),
        ("tare", "", 0.0, "has no load cells"),
        ("calibrate_cell", "S1", 10.0, "has no load cells"),
        ("abort", "", 0.0, "nothing runs"),
    ],
)
def test_what_cannot_be_is_refused_in_words_and_moves_nothing(what: str, name: str, value: float, words: str) -> None:
    with Bench(0, "none") as bench:
        attend(bench)
        ok, reasons = ask(bench, what, name, value)
        assert not ok
        assert words in reasons[0]
        assert bench.tick().phase == "disarmed"


def test_nobody_without_the_controls_may_ask() -> None:
    with Bench(0, "none") as bench:
        attend(bench)
        reply = bench.ask(Request(what="identify", lease="somebody's", name="S1"))
        assert not reply.ok


@pytest.mark.parametrize("how", ["abort", "stop", "disarm", "leaves", "fault", "silent"])
def test_every_way_out_ends_the_step_and_says_why(how: str) -> None:
    with Bench(0, "none") as bench:
        attend(bench)
        assert ask(bench, "test", "S1")[0]
        attend(bench, 40)
        if how == "stop":
            bench.loop.inbox.stop(encode(Stop(who="anna")))
        elif how == "leaves":
            for _ in range(150):
                bench.loop.tick()
                bench.clock.advance(bench.loop.period_s)
        elif how == "fault":
            FaultDesk(CHANNEL).make("overheat S1 95")
            attend(bench, 30)
        elif how == "silent":
            FaultDesk(CHANNEL).make("drop S1")
            attend(bench, 12)
        else:
            assert ask(bench, how)[0]
        bench.loop.tick()
        state = bench.states[-1]
        phases = {"abort": "holding", "stop": "stopped", "disarm": "disarmed", "leaves": "holding", "fault": "fault"}
        words = {"abort": "ended by the driver", "stop": "STOP by anna", "disarm": "", "leaves": "commands stopped arriving",
                 "fault": "95 °C", "silent": "no answer from S1|does not answer"}  # fmt: skip
        assert state.commissioning.outcome == "ended"
        assert state.phase == phases.get(how, "holding")
        assert any(part in state.cause + state.commissioning.words for part in words[how].split("|"))
        FaultDesk(CHANNEL).make("heal")
        # Nothing moves any more, not even back to where it began.
        settled = attend(bench, 40) if how != "leaves" else state
        at = world_of(CHANNEL).travel.copy()
        for _ in range(50):
            bench.loop.tick()
            bench.clock.advance(bench.loop.period_s)
        assert world_of(CHANNEL).travel == pytest.approx(at, abs=2e-5)
        assert not settled.homed


def test_homing_that_fails_leaves_the_tendons_where_they_are() -> None:
    with Bench(0, "none") as bench:  # no plant: no tendon ever pulls
        state = bench.home()
        assert state.phase == "holding"
        at = world_of(CHANNEL).travel.copy()
        attend(bench, 100)
        assert world_of(CHANNEL).travel == pytest.approx(at, abs=1e-4)


def test_homing_again_reports_the_spread_and_leaves_a_robot_that_is_ready() -> None:
    with Bench(0) as bench:
        attend(bench)
        assert ask(bench, "home_repeatedly", value=2.0)[0]
        state = until_over(bench)
        assert (state.phase, state.homed, state.commissioning.outcome) == ("ready", True, "done")
        assert [found.drive for found in state.commissioning.found] == list(COBRA.tendon_names)
        assert all(found.ok for found in state.commissioning.found), state.commissioning.found
        bench.loop.commissioning.stop()
        state = bench.tick()
        assert state.commissioning.calibration.startswith("version 1, ")
        assert world_of(CHANNEL).truth().tensions == pytest.approx(8.0, abs=0.4)


def test_tared_cells_are_believed_and_tell_tension_better_than_the_currents() -> None:
    with Bench(0, losses="nominal", description=replace(COBRA, load_cells=CELLS)) as bench:
        state = attend(bench)
        assert len(state.cells) == 12
        assert all("not tared yet" in cell.trouble for cell in state.cells)
        assert np.isnan(state.cells[0].tension)
        assert ask(bench, "tare")[0]
        state = until_over(bench)
        assert (state.phase, state.homed) == ("disarmed", False)
        assert len(state.commissioning.found) == 12
        state = attend(bench)
        assert all(not cell.trouble for cell in state.cells)
        state = bench.home()
        assert state.phase == "ready", state.cause
        state = attend(bench, 50)
        truth = world_of(CHANNEL).truth().tensions
        measured = np.array([cell.tension for cell in state.cells])
        assert measured == pytest.approx(truth, abs=0.25)
        assert state.tendons.tension == pytest.approx(measured.tolist(), abs=0.2)
        # Beside them what the currents say: the gears' friction, 2 N, is off, and what is left is no tendon's fault.
        assert [cell.from_current for cell in state.cells] == pytest.approx(measured.tolist(), abs=0.6)


def test_a_cell_that_dies_ends_the_drive_once_and_the_currents_stand_in() -> None:
    with Bench(0, description=replace(COBRA, load_cells=CELLS)) as bench:
        attend(bench)
        assert ask(bench, "tare")[0]
        until_over(bench)
        assert bench.home().phase == "ready"
        attend(bench)
        for _ in range(20):
            state = bench.tick(Intent(primary=(0.3, 0.0)))
        assert state.phase == "driving"
        FaultDesk(CHANNEL).make("mute-cell S1")
        for _ in range(40):
            state = bench.tick(Intent(primary=(0.3, 0.0)))
        assert state.phase == "holding"
        assert "load cell of tendon S1: silent" in state.cause
        assert np.isnan(state.cells[0].tension)
        # Neither nothing nor what it said last: what its motor feels.
        assert state.tendons.tension[0] > 2.0
        attend(bench)
        for _ in range(20):
            state = bench.tick(Intent(primary=(-0.3, 0.0)))
        assert state.phase == "driving"


def test_a_cell_that_dies_while_homing_ends_it_instead_of_shifting_a_zero() -> None:
    with Bench(0, description=replace(COBRA, load_cells=CELLS)) as bench:
        attend(bench)
        assert ask(bench, "tare")[0]
        until_over(bench)
        assert bench.home(0.5).phase == "homing"
        FaultDesk(CHANNEL).make("mute-cell S1")
        state = attend(bench, 40)
        assert state.phase == "holding"
        assert "load cell of tendon S1: silent" in state.cause
        assert ask(bench, "home_repeatedly", value=1.0)[0]
        attend(bench, 40)
        FaultDesk(CHANNEL).make("mute-cell E1")
        state = until_over(bench)
        assert (state.phase, state.homed) == ("holding", False)
        assert "load cell of tendon E1: silent" in state.commissioning.words


def restarted(bench: Bench, book: CalibrationBook) -> None:
    """A robot process that has just been started anew, while the drives kept their power."""
    bench.loop = RobotLoop(
        bench.believed, bench._bus, bench.clock, bench.states.append, bench.events.append, calibrations=book
    )
    bench.loop.commissioning.start()
    reply = bench.ask(Request(what="acquire", who="test"))
    bench.lease, bench.epoch = reply.lease, reply.epoch
    attend(bench)


def test_kept_zeros_stand_in_for_homing_where_the_drives_kept_their_power(tmp_path: Path) -> None:
    book = CalibrationBook(COBRA, tmp_path)
    with Bench(0) as bench:
        restarted(bench, book)
        assert not ask(bench, "resume")[0]
        assert ask(bench, "home_repeatedly", value=1.0)[0]
        assert until_over(bench).phase == "ready"
        bench.loop.commissioning.stop()
        bent = [bench.tick(Intent(primary=(0.5, 0.0))) for _ in range(60)][-1].measured
        attend(bench)
        ask(bench, "disarm")
        restarted(bench, CalibrationBook(COBRA, tmp_path))
        attend(bench, 150)  # switched off, the drives give way to the tendons
        before = world_of(CHANNEL).travel.copy()
        assert ask(bench, "resume") == (True, ())
        state = attend(bench)
        assert state.homed
        assert world_of(CHANNEL).travel == pytest.approx(before, abs=1e-4)
        assert state.measured[2:] == pytest.approx(bent[2:], abs=0.35)
        # A drive that lost its count is found out by the others, …
        kept = book.newest
        assert kept is not None
        turned = replace(kept.drives["N2"], zero_rad=kept.drives["N2"].zero_rad + np.pi / 4.5)
        CalibrationBook(COBRA, tmp_path).keep(
            "as if N2 had lost a turn of its motor", drives={**kept.drives, "N2": turned}
        )
        restarted(bench, CalibrationBook(COBRA, tmp_path))
        ok, (why,) = ask(bench, "resume")
        assert not ok
        assert "tendon N2 would be" in why
        assert "off any shape" in why
        assert not bench.tick().homed
        # … or says so itself.
        FaultDesk(CHANNEL).make("slip S3 80")
        attend(bench, 80)
        ok, reasons = ask(bench, "resume")
        assert not ok
        assert "drive S3" in reasons[0]
        assert "home again" in reasons[0]


def test_a_zero_that_moved_alone_is_told_after_homing(tmp_path: Path) -> None:
    book = CalibrationBook(COBRA, tmp_path)
    with Bench(0) as bench:
        restarted(bench, book)
        assert ask(bench, "home_repeatedly", value=1.0)[0]
        assert until_over(bench).phase == "ready"
        bench.loop.commissioning.stop()
        kept = book.newest
        assert kept is not None
        shifted = replace(kept.drives["E1"], zero_rad=kept.drives["E1"].zero_rad + 0.3)
        book.keep("as if E1 had been replaced", drives={"E1": shifted})
        ask(bench, "disarm")
        restarted(bench, CalibrationBook(COBRA, tmp_path))
        assert bench.home().phase == "ready"
        told = [event.text for event in bench.events if "its zero is" in event.text]
        assert len(told) == 1
        assert "tendon E1: its zero is 3." in told[0] or "tendon E1: its zero is 2.9" in told[0]
