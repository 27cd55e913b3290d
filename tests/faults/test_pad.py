"""Claims about the gamepad, on the console's own main beside SDL's virtual pad: it drives, and losing it stops."""

import pytest

from tests.stack import PadStack, wait_for


@pytest.fixture
def stack(tmp_path):
    with PadStack(tmp_path, "--twin", "ideal") as stack:  # it homes in half the time
        yield stack.start()


def ticks(stack: PadStack, count: int) -> None:
    until = stack.observer.state.tick + count
    stack.observer.wait(f"{count} ticks", lambda state: state.tick >= until)


def test_a_pad_arms_drives_stops_and_its_loss_holds(stack):
    stack.arm()
    stack.pad(axis="leftx", value=1.0)
    stack.pad(button="leftshoulder", value=1)
    assert stack.observer.state.phase == "ready", "a deflected stick must be centred before the press"
    stack.pad(button="leftshoulder", value=0)
    stack.pad(axis="leftx", value=0.0)

    stack.press_dead_man()
    stack.pad(tremble=True)
    stack.pad(axis="leftx", value=1.0)
    stack.pad(axis="righty", value=-1.0)
    moved = stack.observer.wait("bends", lambda state: state.commanded[2] > 0.2 and state.commanded[7] < -0.2)
    assert moved.commanded[3] == pytest.approx(0.0, abs=0.02)
    wait_for("the measured bend", lambda: stack.observer.state.measured[2] > 0.2)

    stack.pad(detach=True)
    lost = stack.observer.wait("the end of the drive", lambda state: state.phase != "driving")
    assert lost.phase in ("ready", "holding")
    stack.pad(tremble=False)
    stack.pad(attach=True)
    stack.observer.wait("ready", lambda state: state.phase == "ready")
    stack.pad(axis="righttrigger", value=1.0)
    ticks(stack, 20)  # two changes in one reading of the pad are one press
    fed = stack.observer.state.commanded[1]
    stack.pad(button="leftshoulder", value=1)
    ticks(stack, 50)
    assert stack.observer.state.phase == "ready", "the trigger was not centred at the press"
    assert stack.observer.state.commanded[1] == fed
    stack.pad(axis="righttrigger", value=0.0)
    stack.press_dead_man()


def test_b_stops_even_without_the_dead_man(stack):
    stack.arm()
    stack.pad(button="b", value=1)
    stopped = stack.observer.wait("stopped", lambda state: state.phase == "stopped")
    assert "pad" in stopped.cause
