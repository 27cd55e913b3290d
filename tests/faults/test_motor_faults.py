"""Faults across a process boundary: the drives in a process of their own, python-can's slcan driver between, the real robot
process. Whatever happens to a frame, a drive or the adapter, the robot holds, says so in words, and goes on only when asked."""

import os
import re
import signal
import sys
import time
from collections.abc import Iterator

import numpy as np
import pytest

from tests.served import Rig, served

pytestmark = [pytest.mark.long, pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")]

DRIVEN = 2
"""The first bend of q, which the driver moves."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with served(tmp_path_factory.mktemp("served"), "--slcan", "tcp:0", "--twin", "ideal") as rig:
        yield rig


@pytest.fixture
def rig(shared: Rig) -> Rig:
    shared.ready()
    shared.drive()
    return shared


def stands(rig: Rig) -> None:
    """With the dead-man still held, nothing is commanded to move any more."""
    before = rig.state
    later = rig.observer.wait("ten more ticks", lambda state: state.tick >= before.tick + 40)
    rest = rig.observer.wait("ten more ticks", lambda state: state.tick >= later.tick + 10)
    assert np.array(rest.commanded) == pytest.approx(np.array(later.commanded), abs=1e-9)
    assert rest.phase in ("holding", "fault")


@pytest.mark.parametrize(
    ("fault", "phase", "words"),
    [
        ("drop E2", "holding", "no answer from E2: check power and cable"),
        ("delay N1 40", "holding", "no answer from N1"),
        ("overheat W3 95", "fault", "drive W3: .*95 °C, at most 80"),
        ("undervoltage 15", "fault", "drives? .*: undervoltage"),
        ("slip twist 120", "fault", "drive twist: its angle jumped by .* degrees .*home again"),
        ("drop all", "fault", "14 drives: nobody answers on bus 'main'"),
        ("bus-off main", "fault", "14 drives: nobody answers on bus 'main'"),
    ],
)
def test_the_whole_robot_holds_and_says_why(rig: Rig, fault: str, phase: str, words: str) -> None:
    began = rig.state.stamp
    rig.drives.make(fault)
    state = rig.observer.wait("the hold", lambda state: state.phase == phase)
    print(f"{fault}: held {1e3 * (state.stamp - began):.0f} ms after it was asked for: {state.cause}")
    assert state.cause

    assert re.search(words, state.cause), state.cause
    stands(rig)


@pytest.mark.parametrize("fault", ["drop all 0.02", "duplicate all 0.2", "delay all 1"])
def test_what_a_bus_can_bear_is_counted_and_driven_through(rig: Rig, fault: str) -> None:
    before = rig.state
    rig.drives.make(fault)
    state = rig.observer.wait("a second of it", lambda state: state.tick >= before.tick + 50)
    assert state.phase == "driving", state.cause
    assert "Traceback" not in rig.output.read_text()


def test_corrupted_replies_never_move_anything_by_themselves(rig: Rig) -> None:
    rig.let_go()
    rig.observer.wait("rest", lambda state: state.phase == "ready")
    time.sleep(0.5)
    before = rig.state
    rig.drives.make("corrupt all 0.05")
    state = rig.observer.wait("a second of it", lambda state: state.tick >= before.tick + 50)
    assert np.array(state.commanded) == pytest.approx(np.array(before.commanded), abs=1e-9)
    assert state.phase in ("ready", "fault", "holding")
    assert "Traceback" not in rig.output.read_text()


def test_a_blocked_drive_is_told_by_its_current(rig: Rig) -> None:
    rig.drives.make("stall S1")
    state = rig.observer.wait("the hold", lambda state: state.phase in ("holding", "fault") or "S1" in state.cause)
    assert "S1" in state.cause


def test_drives_that_stop_for_a_while_get_no_setpoint_from_before(rig: Rig) -> None:
    os.kill(rig.drives.process.pid, signal.SIGSTOP)
    try:
        state = rig.observer.wait("the fault", lambda state: state.phase == "fault")
        assert "bus 'main'" in state.cause
        time.sleep(0.5)
    finally:
        os.kill(rig.drives.process.pid, signal.SIGCONT)
    stands(rig)
    rig.ready()


def test_the_drives_outlive_the_link_and_an_adapter_that_comes_back_is_found_and_armed_anew(rig: Rig) -> None:
    channel = rig.drives.channels["main"]
    rig.drives.end()
    state = rig.observer.wait("word of it", lambda state: state.phase in ("holding", "fault"))
    assert "bus 'main' (slcan socket://" in state.cause
    assert "It is looked for again every second" in state.cause
    rig.let_go()
    rig.drives.start("--slcan", f"tcp:{channel.rpartition(':')[2]}")
    state = rig.observer.wait("the adapter", lambda state: state.phase == "fault" and all(state.drives.valid))
    assert "arm again" in state.cause
    assert state.reasons
    rig.ready()


@pytest.fixture(scope="module")
def on_pty(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    """Serial lines as an adapter on USB has them, and a twin whose tendons stretch and rub."""
    with served(tmp_path_factory.mktemp("pty"), "--slcan", "pty") as rig:
        yield rig


def test_a_tendon_near_its_highest_tension_slows_the_robot_and_is_named(on_pty: Rig) -> None:
    assert on_pty.drives.channels["main"].startswith("/dev/pts/")
    on_pty.ready()
    assert on_pty.ask("pretension", 34.0).ok
    on_pty.observer.wait("the tension", lambda state: min(state.tendons.tension, default=0.0) > 32.0)
    on_pty.drive()
    state = on_pty.observer.wait("the limit", lambda state: " N: " in state.cause)
    assert re.search(r"tendon [SENW][123] is (near|above) 40 N", state.cause)
    assert max(on_pty.state.tendons.tension) < 44.0
    on_pty.let_go()
    on_pty.observer.wait("rest", lambda state: state.phase == "ready")
    # Where there is no room between pretension and limit, whatever happens next makes the robot give way.
    assert on_pty.ask("pretension", 8.0).ok
    on_pty.observer.wait("the tension", lambda state: max(state.tendons.tension) < 12.0)


def test_a_tendon_that_goes_slack_stops_the_robot_is_named_and_is_well_once_it_is_homed(on_pty: Rig) -> None:
    on_pty.ready()
    on_pty.drive()
    on_pty.drives.make("loosen E1 12")
    state = on_pty.observer.wait("the hold", lambda state: state.phase == "holding")
    assert "tendon E1" in state.cause
    assert re.search("slack|off its spool|slipped", state.cause), state.cause
    stands(on_pty)
    on_pty.let_go()
    on_pty.observer.wait("word from the robot", lambda state: state.phase in ("ready", "holding"))
    assert on_pty.ask("home").ok
    on_pty.observer.wait("homing", lambda state: state.phase == "homing")
    state = on_pty.observer.wait("the end of homing", lambda state: state.phase != "homing", 60.0)
    assert (state.phase, state.tendons.warnings) == ("ready", ()), state.cause
    on_pty.drive()
    on_pty.let_go()


def test_a_broken_tendon_stops_the_robot_and_is_named(on_pty: Rig) -> None:
    on_pty.ready()
    on_pty.drive()
    on_pty.drives.make("break N1")
    state = on_pty.observer.wait("the hold", lambda state: state.phase == "holding")
    assert "tendon N1" in state.cause
    assert "broken or off its spool" in state.cause or "slack" in state.cause
    stands(on_pty)
    # And homing finds it too, instead of winding for ever.
    on_pty.let_go()
    on_pty.observer.wait("word from the robot", lambda state: state.phase in ("ready", "holding"))
    assert on_pty.ask("home").ok
    state = on_pty.observer.wait("the end of homing", lambda state: "homing failed" in state.cause, 60.0)
    assert "tendon N1 was wound in by" in state.cause
