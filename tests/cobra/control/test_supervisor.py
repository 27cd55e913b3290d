"""Claims about the robot's states: nothing moves without a fresh held command, and after every end: release, centre, press."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobra.control.supervisor import Drive, Health, Supervisor
from cobra.messages import Command, Intent

WELL = Health()
SILENT = Health(blocking=("no answer from S1: check power and cable",))
HOT = Health(faults=("drive S1: too hot",))


def drive(held: bool, arrival: float, x: float = 0.0) -> Drive:
    return Drive(Command(lease="a", epoch=1, sequence=1, echo=0.0, held=held, intent=Intent(primary=(x, 0.0))), arrival)


@pytest.fixture
def ready() -> Supervisor:
    supervisor = Supervisor()
    supervisor.armed()
    assert supervisor.phase == "homing"
    supervisor.homing_done()
    return supervisor


def press(supervisor: Supervisor, now: float = 1.0) -> None:
    assert not supervisor.tick(now, drive(False, now), WELL)
    assert supervisor.tick(now + 0.01, drive(True, now + 0.01), WELL)


def test_release_centre_press_drives(ready):
    press(ready)
    assert ready.phase == "driving"
    assert ready.tick(1.02, drive(True, 1.02, x=1.0), WELL)


def test_holding_the_button_from_before_does_not_drive(ready):
    for i in range(20):
        assert not ready.tick(1.0 + i / 100, drive(True, 1.0 + i / 100), WELL)


def test_a_deflected_stick_must_be_centred_before_the_press(ready):
    assert not ready.tick(1.0, drive(False, 1.0, x=0.5), WELL)
    assert not ready.tick(1.01, drive(True, 1.01, x=0.5), WELL)
    assert ready.phase == "ready"


def test_letting_go_stops_in_the_same_tick_without_a_warning(ready):
    press(ready)
    assert not ready.tick(1.02, drive(False, 1.02, x=1.0), WELL)
    assert (ready.phase, ready.cause) == ("ready", "")


def test_a_drive_that_its_console_ended_says_why_until_the_next_press(ready):
    press(ready)
    told = msgspec.structs.replace(drive(False, 1.02).command, ended="page 1 fell silent")
    assert not ready.tick(1.02, Drive(told, 1.02), WELL)
    assert (ready.phase, ready.cause) == ("ready", "page 1 fell silent. Let go, centre, press again.")
    press(ready, 2.0)
    assert (ready.phase, ready.cause) == ("driving", "")


def test_a_lost_stream_holds_after_the_validity_and_says_what_to_do(ready):
    press(ready)
    last = drive(True, 1.01)
    assert ready.tick(1.20, last, WELL)
    assert not ready.tick(1.22, last, WELL)
    assert ready.phase == "holding"
    assert "press again" in ready.cause
    # The stream comes back with the button still held: nothing moves.
    assert not ready.tick(1.3, drive(True, 1.3), WELL)
    assert not ready.tick(1.31, drive(False, 1.31), WELL)
    assert ready.tick(1.32, drive(True, 1.32), WELL)


def test_a_silent_motor_holds_the_whole_robot_until_it_answers(ready):
    press(ready)
    assert not ready.tick(1.02, drive(True, 1.02), SILENT)
    assert (ready.phase, ready.cause) == ("holding", SILENT.blocking[0])
    assert not ready.tick(1.03, drive(False, 1.03), SILENT)
    assert ready.phase == "holding"
    press(ready, 1.04)


def test_a_fault_disarms(ready):
    press(ready)
    assert not ready.tick(1.02, drive(True, 1.02), HOT)
    assert ready.phase == "fault"
    assert "S1" in ready.cause
    assert not ready.tick(1.03, drive(False, 1.03), WELL)
    assert ready.phase == "fault"


def test_a_drive_that_lost_its_reference_must_be_homed_again(ready):
    press(ready)
    lost = Health(faults=("drive S1: its angle jumped by +90.0 degrees: home again",))
    assert not ready.tick(1.02, drive(True, 1.02), lost)
    assert (ready.phase, ready.homed) == ("fault", False)
    ready.armed()
    assert ready.phase == "homing"


def test_a_stop_latches_until_it_is_cleared_and_clearing_moves_nothing(ready):
    press(ready)
    ready.stop("viewer 3", "smoke")
    for i in range(10):
        assert not ready.tick(1.1 + i / 100, drive(i % 2 == 0, 1.1 + i / 100), WELL)
    assert ready.phase == "stopped"
    assert "viewer 3" in ready.cause
    assert "smoke" in ready.cause
    ready.clear()
    assert not ready.tick(1.3, drive(True, 1.3), WELL)
    assert ready.phase == "ready"


def test_a_stop_during_homing_needs_homing_again():
    supervisor = Supervisor()
    supervisor.armed()
    supervisor.stop("", "")
    supervisor.clear()
    assert supervisor.phase == "holding"
    assert not supervisor.homed
    assert "home" in supervisor.cause


def test_arming_names_every_reason():
    supervisor = Supervisor()
    assert supervisor.arming_reasons(SILENT, None, 1.0) == (
        SILENT.blocking[0],
        "nobody drives: take the controls first",
    )
    assert "let it go" in supervisor.arming_reasons(WELL, drive(True, 1.0), 1.0)[0]
    assert "centred" in supervisor.arming_reasons(WELL, drive(False, 1.0, x=0.3), 1.0)[0]
    assert "no input" in supervisor.arming_reasons(WELL, drive(False, 1.0), 2.0)[0]
    assert supervisor.arming_reasons(WELL, drive(False, 1.0), 1.0) == ()


@given(
    st.lists(
        st.tuples(st.booleans(), st.floats(0, 0.4), st.sampled_from([0.0, 0.5]), st.sampled_from([WELL, WELL, SILENT])),
        max_size=60,
    )
)
def test_whatever_happens_only_a_fresh_held_command_after_release_and_centre_moves(history):
    supervisor = Supervisor()
    supervisor.homed = True
    supervisor.armed()
    now, released, was_moving = 1.0, False, False
    for held, age, x, health in history:
        now += 0.01
        moving = supervisor.tick(now, drive(held, now - age, x), health)
        if moving:
            assert held
            assert age <= 0.2 + 1e-9
            assert not health.blocking
            assert was_moving or released
        if not held and x == 0.0 and age <= 0.2 and not health.blocking:
            released = True
        elif not moving:
            released = False
        was_moving = moving
