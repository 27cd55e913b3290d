"""The pad as SDL gives it: virtual devices inside this process, real SDL, real pygame."""

import contextlib
import json
import math
import subprocess
import sys
import threading
import time
from queue import Empty, Queue

import pytest

from app.console.gamepad import REFRESH_MS, Gamepad
from tests.console_with_pad import Hand

PATIENCE_S = 10.0


class Reader:
    """A running `Gamepad` and all that it reported."""

    def __init__(self):
        self.changes = Queue()
        self.gate = threading.Event()
        self.gate.set()
        self.pad = Gamepad(self._listen)
        self.pad.start()
        self.until(lambda: self.pad.polls > 0)

    def _listen(self, controls):
        self.changes.put(controls)
        # While the gate is shut, the pad's thread hangs after the next change it reports.
        assert self.gate.wait(PATIENCE_S)

    def until(self, condition):
        """Wait for a condition, at the pace of the pad's own thread."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, f"not in time; newest {self.pad.read()}, pads {self.pad.pads}"
            threading.Event().wait(0.001)

    def change(self, matches):
        """The next reported change that matches; those before it are passed over."""
        deadline = time.monotonic() + PATIENCE_S
        while True:
            try:
                controls = self.changes.get(timeout=max(0.0, deadline - time.monotonic()))
            except Empty:
                pytest.fail(f"no such change; newest {self.pad.read()}")
            if matches(controls):
                return controls

    def settle(self):
        """Wait until whatever was done to the devices has been read."""
        seen = self.pad.polls
        self.until(lambda: self.pad.polls >= seen + 3)


@pytest.fixture
def reader():
    reader = Reader()
    yield reader
    reader.pad.stop()


def drive_deflected(pad, reader):
    pad.button("left_shoulder")
    pad.axis("leftx", 0.7)
    reader.change(lambda c: c.connected and c.left[0] > 0.69 and "left_shoulder" in c.buttons)


def test_without_a_pad_it_says_so(reader):
    assert not reader.pad.read().connected
    assert reader.pad.problem == "no pad is plugged in"


def test_a_pad_that_is_plugged_in_is_read(reader, plug):
    pad = plug("Red Pad")
    reader.until(lambda: reader.pad.read().connected)
    assert reader.pad.name == "Red Pad"
    assert reader.pad.problem == ""
    for axis, setting in (("leftx", 0.5), ("lefty", -0.25), ("rightx", -1.0), ("righty", 1.0)):
        pad.axis(axis, setting)
    pad.axis("lefttrigger", 0.25)
    pad.axis("righttrigger", 1.0)
    controls = reader.change(lambda c: c.right_trigger == 1.0)
    assert controls.left == pytest.approx((0.5, -0.25), abs=1e-4)
    assert controls.right == (-1.0, 1.0)
    assert controls.left_trigger == pytest.approx(0.25, abs=1e-4)


def test_every_button_arrives_under_its_own_name(reader, plug):
    pad = plug()
    reader.until(lambda: reader.pad.read().connected)
    for button in (
        *("a", "b", "x", "y", "back", "start", "left_stick", "right_stick", "left_shoulder", "right_shoulder"),
        *("dpad_up", "dpad_down", "dpad_left", "dpad_right"),
    ):
        pad.button(button)
        assert reader.change(lambda c: c.buttons).buttons == {button}
        pad.button(button, down=False)
        reader.change(lambda c: not c.buttons)


def test_a_press_of_stop_shorter_than_a_reading_is_not_lost(reader, plug):
    pad = plug()
    reader.until(lambda: reader.pad.read().connected)
    reader.gate.clear()
    pad.axis("leftx", 0.3)
    reader.change(lambda c: c.left[0] > 0)
    for down in (True, False):
        pad.button("b", down)
        pad.update()
    reader.gate.set()
    assert reader.change(lambda c: "b" in c.buttons)
    assert reader.change(lambda c: "b" not in c.buttons)


def test_a_headset_without_axes_is_no_pad(reader, plug):
    plug("Headset", axes=0)
    plug("Headset that SDL maps", axes=0, mapped=False)
    pad = plug("Pad")
    reader.until(lambda: reader.pad.read().connected)
    assert [p.name for p in reader.pad.pads] == ["Pad"]
    drive_deflected(pad, reader)
    plug("Second headset", axes=0)
    reader.settle()
    assert reader.pad.read().connected, "a headset that comes does not end the drive"


def test_a_device_without_a_controller_mapping_is_refused_with_a_message(reader, plug):
    plug("Flight Stick", axes=4, mapped=False)
    reader.until(lambda: reader.pad.pads)
    assert not reader.pad.pads[0].usable
    assert "Flight Stick" in reader.pad.problem
    assert "SDL_GAMECONTROLLERCONFIG" in reader.pad.problem
    with pytest.raises(ValueError, match="no usable pad is called 'Flight Stick'"):
        reader.pad.choose("Flight Stick")


def test_pulling_the_pad_out_while_it_is_deflected_ends_it_at_once(reader, plug):
    pad = plug("Red Pad")
    reader.until(lambda: reader.pad.read().connected)
    drive_deflected(pad, reader)
    pad.detach()
    gone = reader.change(lambda c: not c.connected)
    assert gone.left == (0.0, 0.0)
    assert gone.buttons == frozenset()
    assert reader.pad.problem == "Red Pad is gone: plug it in again or choose another pad"


def test_after_a_re_plug_nothing_is_trusted_until_the_buttons_are_let_go(reader, plug):
    pad = plug()
    reader.until(lambda: reader.pad.read().connected)
    drive_deflected(pad, reader)
    reader.gate.clear()
    pad.detach()
    reader.change(lambda c: not c.connected)
    # Plugged in while the hand still holds the dead-man: it is down from the first reading on.
    pad.attach()
    pad.button("left_shoulder")
    pad.axis("leftx", 0.7)
    pad.update()
    reader.gate.set()
    held = reader.change(lambda c: "left_shoulder" in c.buttons)
    assert not held.connected
    reader.settle()
    assert not reader.pad.read().connected
    pad.button("left_shoulder", down=False)
    assert reader.change(lambda c: c.connected).buttons == frozenset()


def test_a_second_pad_never_takes_over(reader, plug):
    first = plug("First")
    reader.until(lambda: reader.pad.read().connected)
    second = plug("Second")
    reader.until(lambda: len(reader.pad.pads) == 2)
    second.button("left_shoulder")
    second.axis("leftx", 1.0)
    reader.settle()
    assert reader.pad.name == "First"
    assert reader.pad.read().buttons == frozenset()
    first.detach()
    reader.until(lambda: not reader.pad.read().connected)
    reader.settle()
    plug("Third")
    reader.until(lambda: len(reader.pad.pads) == 2)
    reader.settle()
    assert reader.pad.name == "First", "it stays the chosen one while it is gone"
    assert not reader.pad.read().connected
    first.attach()
    reader.until(lambda: reader.pad.read().connected)
    assert reader.pad.name == "First"


def test_a_pad_that_comes_while_another_drives_ends_the_drive(reader, plug):
    pad = plug("First")
    reader.until(lambda: reader.pad.read().connected)
    drive_deflected(pad, reader)
    plug("Second")
    reader.change(lambda c: not c.connected)
    pad.button("left_shoulder", down=False)
    reader.change(lambda c: c.connected)


def test_another_pad_drives_only_when_it_is_chosen_and_then_lets_go_first(reader, plug):
    plug("First")
    reader.until(lambda: reader.pad.read().connected)
    second = plug("Second")
    reader.until(lambda: len(reader.pad.pads) == 2)
    second.button("left_shoulder")
    reader.settle()
    reader.pad.choose("Second")
    reader.until(lambda: reader.pad.name == "Second")
    reader.settle()
    assert "left_shoulder" in reader.pad.read().buttons
    assert not reader.pad.read().connected
    second.button("left_shoulder", down=False)
    reader.until(lambda: reader.pad.read().connected)


def test_two_pads_of_one_kind_can_be_told_apart(reader, plug):
    plug("Twin Pad")
    reader.until(lambda: reader.pad.read().connected)
    second = plug("Twin Pad")
    reader.until(lambda: len(reader.pad.pads) == 2)
    assert [(p.name, p.chosen) for p in reader.pad.pads] == [("Twin Pad", True), ("Twin Pad (2)", False)]
    reader.pad.choose("Twin Pad (2)")
    reader.until(lambda: reader.pad.name == "Twin Pad (2)")
    second.axis("righty", 0.5)
    reader.change(lambda c: c.right[1] > 0.49)


def test_a_pad_that_was_there_before_the_start_is_chosen(plug):
    plug("Early")
    reader = Reader()
    try:
        reader.until(lambda: reader.pad.read().connected)
        assert reader.pad.name == "Early"
    finally:
        reader.pad.stop()
    assert not reader.pad.read().connected
    assert reader.pad.pads == ()


def test_only_changes_are_reported_while_the_stamp_stays_fresh(reader, plug):
    pad = plug()
    reader.change(lambda c: c.connected)
    pad.axis("leftx", 0.5)
    reader.change(lambda c: c.left[0] > 0.4)
    stamp, polls = reader.pad.read().stamp, reader.pad.polls
    reader.until(lambda: reader.pad.polls >= polls + 20)
    assert reader.pad.read().stamp - stamp >= 0.5 * 20 * REFRESH_MS / 1000
    assert reader.changes.empty()


def test_a_hanging_pad_thread_shows_in_the_stamp(reader, plug):
    pad = plug()
    reader.until(lambda: reader.pad.read().connected)
    reader.gate.clear()
    pad.button("left_shoulder")
    reader.change(lambda c: c.buttons)
    stamp, polls = reader.pad.read().stamp, reader.pad.polls
    threading.Event().wait(5 * REFRESH_MS / 1000)
    assert reader.pad.read().stamp == stamp
    assert reader.pad.polls == polls
    reader.gate.set()
    reader.until(lambda: reader.pad.read().stamp > stamp)


def test_a_listener_that_fails_is_counted_and_the_pad_goes_on(plug, caplog):
    pad_thread_survives = Gamepad(lambda _controls: 1 / 0)
    pad_thread_survives.start()
    try:
        plug()
        deadline = time.monotonic() + PATIENCE_S
        while not pad_thread_survives.read().connected and time.monotonic() < deadline:
            threading.Event().wait(0.001)
        assert pad_thread_survives.read().connected
        assert pad_thread_survives.errors["callback"] >= 1
    finally:
        pad_thread_survives.stop()
    assert "the pad's listener failed" in caplog.text


def test_reading_the_pad_leaves_the_process_its_signals():
    # SDL would take SIGTERM for itself and turn it into an event: the console could not be ended.
    program = (
        "import os, signal, time\n"
        "from app.console.gamepad import Gamepad\n"
        "pad = Gamepad(); pad.start()\n"
        "while not pad.polls: time.sleep(0.001)\n"
        "os.kill(os.getpid(), signal.SIGTERM); time.sleep(10)"
    )
    ended = subprocess.run([sys.executable, "-c", program], timeout=30, check=False)
    assert ended.returncode == -15


def test_values_are_finite_and_within_one_at_the_ends_of_travel(reader, plug):
    pad = plug()
    reader.until(lambda: reader.pad.read().connected)
    pad._sdl.SDL_JoystickSetVirtualAxis(pad._joystick, 0, -32768)  # one step further than +1 goes
    controls = reader.change(lambda c: c.left[0] < 0)
    assert controls.left[0] == -1.0
    assert all(math.isfinite(v) for v in (*controls.left, *controls.right))


@pytest.fixture
def hand():
    hand = Hand()
    yield hand
    hand.obey({"tremble": False})
    with contextlib.suppress(ValueError):
        hand.obey({"detach": True})


def test_the_launchers_hand_moves_the_pad_by_lines_of_json(reader, hand):
    reader.until(lambda: reader.pad.read().connected)
    for request in (
        '{"axis": "leftx", "value": -0.5}',
        '{"axis": "lefttrigger", "value": 1}',
        '{"button": "leftshoulder", "value": 1}',
        '{"button": "dpup", "value": 1}',
    ):
        hand.obey(json.loads(request))
    controls = reader.change(lambda c: len(c.buttons) == 2)
    assert controls.buttons == {"left_shoulder", "dpad_up"}
    reader.until(lambda: reader.pad.read().left_trigger == 1.0)
    assert reader.pad.read().left[0] == pytest.approx(-0.5, abs=1e-4)
    hand.obey({"detach": True})
    reader.change(lambda c: not c.connected)
    with pytest.raises(ValueError, match="not plugged in"):
        hand.obey({"axis": "leftx", "value": 0.5})
    hand.obey({"attach": True})
    assert reader.change(lambda c: c.connected).left == (0.0, 0.0)


@pytest.mark.parametrize(
    "wrong",
    ['{"axis": "nose", "value": 1}', '{"axis": "leftx", "value": NaN}', '{"axis": "leftx", "value": 2}', "[]", "{}"],
)
def test_the_launchers_hand_refuses_what_it_does_not_know(hand, wrong):
    with pytest.raises(ValueError, match=r".+"):
        hand.obey(json.loads(wrong))


def test_the_launchers_hand_trembles_like_a_hand_until_it_is_told_to_freeze(reader, hand):
    reader.until(lambda: reader.pad.read().connected)
    hand.obey({"axis": "leftx", "value": 0.6})
    hand.obey({"tremble": True})
    seen = {reader.change(lambda c: c.left[0] > 0.5).left[0] for _ in range(5)}
    assert len(seen) > 2
    assert max(seen) - min(seen) < 0.005
    hand.obey({"tremble": False})
    reader.settle()
    while not reader.changes.empty():
        reader.changes.get()
    reader.settle()
    reader.settle()
    assert reader.changes.empty()
