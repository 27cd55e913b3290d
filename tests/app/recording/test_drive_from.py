"""Claims about recorded sticks: they drive the twin the way they drove before, and never anything that is real."""

import contextlib
import re
import time
from pathlib import Path
from typing import Any

import can
import msgspec
import pytest

from app.cli import main
from app.recording import channels, storage
from app.recording.catalogue import sessions
from app.recording.container import RecordingError
from app.recording.drive_from import DriveFrom, compare, drives_of, refuse_real_buses
from app.recording.reader import Recording
from cobra.messages import Calibration, Meta, RobotState
from tests.recordings import COBRA, moving, write
from tests.stack import Page, Stack, running, wait_for


@pytest.mark.parametrize("interface", ["socketcan", "slcan", "virtual", "pcan"])
def test_a_real_bus_is_refused_in_one_line(interface):
    buses = (msgspec.structs.replace(COBRA.buses[0], interface=interface, channel="can0"),)
    with pytest.raises(RecordingError, match=f"a real one .{interface} can0") as raised:
        refuse_real_buses(msgspec.structs.replace(COBRA, buses=buses))
    assert "\n" not in str(raised.value)
    refuse_real_buses(COBRA)


def test_one_real_bus_among_simulated_ones_is_enough():
    real = msgspec.structs.replace(COBRA.buses[0], name="second", interface="socketcan")
    with pytest.raises(RecordingError, match="'second'"):
        refuse_real_buses(msgspec.structs.replace(COBRA, buses=(*COBRA.buses, real)))


@pytest.mark.parametrize("bus", ["main=socketcan:can0", "main=slcan:/dev/ttyACM0"])
def test_a_bus_that_is_led_to_a_real_one_is_refused_before_anything_starts(tmp_path, bus, capsys, monkeypatch):
    write(tmp_path / "a.mcap", 1.5)
    monkeypatch.setenv("COBRA_TELEOP_RUNTIME_DIR", str(tmp_path))
    with pytest.raises(SystemExit) as ended:
        main(["--drive-from", str(tmp_path / "a.mcap"), "--bus", bus, "--no-open", "--port", "0"])
    assert ended.value.code == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "--drive-from drives a twin only: bus 'main'" in told
    assert not list(tmp_path.glob("*.json"))


def test_a_running_robot_process_on_a_real_bus_is_refused_whatever_its_description_says(tmp_path):
    with pytest.raises(RecordingError, match="was started on a real bus"):
        DriveFrom(tmp_path / "a.mcap", COBRA, None, simulated=False, arm=None, latest=None, wake=None, tell=None)
    assert not Meta(description="", versions={}, pid=1).simulated, "of one that does not say, the worst is believed"


def test_the_presses_are_found_and_a_recording_in_which_nobody_drove_is_refused(tmp_path):
    write(tmp_path / "a.mcap", 2.0)
    with Recording(tmp_path / "a.mcap") as recording:
        (drive,) = drives_of(recording)
        assert len(drive.readings) == 100
    write(tmp_path / "b.mcap", 0.0)
    with Recording(tmp_path / "b.mcap") as recording, pytest.raises(RecordingError, match="nobody drove"):
        drives_of(recording)


def test_the_comparison_is_of_equal_times_of_driving_whatever_the_pauses():
    recorded = [moving(i / 50) for i in range(100)]
    later = [msgspec.structs.replace(state, stamp=state.stamp + 77.0) for state in recorded]
    paused = [
        msgspec.structs.replace(state, stamp=state.stamp + (5.0 if i >= 50 else 0.0)) for i, state in enumerate(later)
    ]
    assert compare(COBRA, recorded, later).largest_m == pytest.approx(0.0, abs=1e-9)
    assert compare(COBRA, recorded, paused).largest_m < 0.01
    ahead = [moving(i / 50 + 0.5, stamp=state.stamp) for i, state in enumerate(recorded)]
    apart = compare(COBRA, recorded, ahead)
    assert apart.largest_m > 0.02
    assert apart.rms_m <= apart.largest_m
    assert apart.way_m > 0.1


def pressed(page: Page) -> bool:
    """Press the dead-man as a person does: again, when a stall of the machine made the press void."""
    page.release()
    with contextlib.suppress(AssertionError):
        wait_for("ready", lambda: page.snapshot["phase"] == "ready", 2.0)
    time.sleep(0.2)
    page.hold()
    with contextlib.suppress(AssertionError):
        page.until_phase("driving", 2.0)
    return bool(page.snapshot["phase"] == "driving")


def drive_recorded(folder: Path, robot: str, **sticks: Any) -> Path:
    """A session of the whole program, with its frames beside it: arm, drive, leave a mark. Gives its recording."""
    folder.mkdir()
    with running(folder, "--record-can", robot=robot) as stack, Page(stack.url) as page:
        page.arm()
        wait_for("the drive", lambda: pressed(page), 60.0)
        page.hold(**sticks)
        time.sleep(1.5)
        page.release()
        page.until_phase("ready")
        assert page.snapshot["recording"]["problem"] == ""
        wait_for("a marker", lambda: page.ask("mark")["ok"])
        stack.end()
    (session,) = sessions(folder / "recordings")
    assert (session.status, session.markers) == ("closed", 1)
    return folder / "recordings" / session.name


def driven_from(folder: Path, robot: str, path: Path) -> tuple[str, RobotState]:
    """What the program says of the comparison after it drove from a recording, and the robot's last state."""
    folder.mkdir()
    with Stack(folder, "--drive-from", str(path), "--no-record", robot=robot) as stack:
        stack.start()
        words = wait_for(
            "the comparison", lambda: re.search(r"drove .* way of [\d.]+ m", stack.output.read_text()), 60.0
        ).group(0)
        assert stack.observer is not None
        state = stack.observer.state
        stack.end()
    print(words)
    apart_mm = float(re.search(r"at the end ([\d.]+) mm", words).group(1))
    way_m = float(re.search(r"way of ([\d.]+) m", words).group(1))
    assert way_m >= 0.01, words
    assert apart_mm < 0.1 * 1e3 * way_m, words
    return words, state


def test_a_session_of_the_program_is_recorded_whole_and_its_sticks_drive_the_twin_again(tmp_path):
    robot = "cobra-twist-feed"  # needs no homing
    path = drive_recorded(tmp_path / "first", robot, rt=0.7, right=[0.8, 0.0], buttons=["right_shoulder"])
    with Recording(path) as recording:
        assert "Marker" in next(event.text for _, event in recording.events() if event.level == "marker")
        driven = [state for _, state in recording.states() if state.phase == "driving"]
        assert recording.digest.missed == 0
        calibration = channels.decode(recording.attachments["calibration.json"], Calibration)
        assert calibration.homed
        assert set(calibration.drives) == {"twist", "feed"}
        states = recording.digest.states
        begin_s, end_s = 1e-9 * recording.start_ns, 1e-9 * recording.end_ns
    (log,) = storage.frames_of(path)
    frames = list(can.LogReader(log))
    within = [frame for frame in frames if begin_s < frame.timestamp < end_s]
    assert len(within) > 0.9 * states * 4, "two drives, asked and answering, every tick"
    assert {frame.is_rx for frame in frames} == {True, False}
    _, state = driven_from(tmp_path / "second", robot, path)
    assert state.measured[1] > driven[0].measured[1] + 0.003, "it was fed in"
    assert state.measured[0] == pytest.approx(driven[-1].measured[0], abs=0.05)


@pytest.mark.long
def test_recorded_sticks_bend_the_twin_to_the_same_place(tmp_path):
    path = drive_recorded(tmp_path / "first", "cobra", left=[0.8, 0.3], rt=0.7)
    driven_from(tmp_path / "second", "cobra", path)
