"""`cobra-teleop motors …` against drives in another process, behind python-can's own slcan driver; and what it refuses."""

import contextlib
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import can
import pytest

from app import runtime
from app.cli import main
from cobra.loading import description_text
from tests.served import Drives


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Drives]:
    drives = Drives(tmp_path_factory.mktemp("drives"), "--slcan", "tcp:0", "--twin", "none")
    yield drives
    drives.end()


@pytest.fixture(autouse=True)
def own_folders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COBRA_TELEOP_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setenv("COBRA_TELEOP_DATA_DIR", str(tmp_path / "data"))


def teleop(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    told = capsys.readouterr()
    return int(ended.value.code or 0), told.out, told.err


def test_a_bare_adapter_tells_who_is_there_and_moves_the_one_that_is_meant(
    served: Drives, capsys: pytest.CaptureFixture[str]
) -> None:
    adapter = ("--interface", "slcan", "--channel", f"{served.channels['main']}?sleep_after_open=0")
    status, out, _ = teleop(capsys, "motors", "scan", *adapter)
    lines = [line.split() for line in out.splitlines()[1:]]
    assert (status, [line[1] for line in lines]) == (0, [str(k) for k in range(1, 15)])
    assert lines[0][3:5] == ["RMD", "v1"]
    assert "36 V" in out
    status, out, _ = teleop(capsys, "motors", "identify", "5", *adapter)
    assert status == 0
    assert "address 5" in out
    assert "it swung 30.0 degrees by its own encoder" in out
    status, _, err = teleop(capsys, "motors", "identify", "17", *adapter)
    assert status == 2
    assert "no motor answers to address 17" in err
    assert "there answers 1, 2, 3" in err


@contextlib.contextmanager
def virtual_adapter(name: str) -> Iterator[None]:
    """Simulated drives behind python-can's own virtual interface: whatever is sent on either side is passed to the other."""
    done = threading.Event()
    with (
        can.Bus(interface="cobra-sim", channel="cobra", twin="none") as drives,
        can.Bus(interface="virtual", channel=name) as adapter,
    ):

        def forward(source: can.BusABC, sink: can.BusABC) -> None:
            while not done.is_set():
                if (frame := source.recv(0.05)) is not None:
                    sink.send(frame)

        threads = [threading.Thread(target=forward, args=ends) for ends in ((drives, adapter), (adapter, drives))]
        for thread in threads:
            thread.start()
        yield
        done.set()
        for thread in threads:
            thread.join()


@pytest.mark.long
def test_any_interface_of_python_can_will_do(capsys: pytest.CaptureFixture[str]) -> None:
    with virtual_adapter("commission"):
        adapter = ("--interface", "virtual", "--channel", "commission")
        status, out, _ = teleop(capsys, "motors", "scan", *adapter)
        assert (status, len(out.splitlines())) == (0, 15)
        for _ in range(4):  # a busy machine that stalls ends it, as it must
            status, out, err = teleop(capsys, "motors", "identify", "2", *adapter)
            if status == 0:
                break
        assert status == 0, err
        assert "degrees by its own encoder" in out


def test_a_described_robot_is_compared_with_who_answers(
    served: Drives, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    robot = tmp_path / "cobra.toml"
    robot.write_text(description_text("cobra").replace("address = 14", "address = 30"), "utf-8")
    route = ("--robot", str(robot), "--bus", f"main=slcan:{served.channels['main']}?sleep_after_open=0")
    status, out, _ = teleop(capsys, "motors", "scan", *route)
    assert status == 2
    assert "described, but silent: feed (address 30) on bus main" in out
    assert "not described" in out
    status, out, _ = teleop(capsys, "motors", "test", "twist", *route)
    assert status == 0, out
    assert "went right, then left by 2.0 degrees" in out
    status, _, err = teleop(capsys, "motors", "home", *route)
    assert status == 2
    assert "drive 'feed' (address 30 on bus 'main'" in err
    assert "does not answer" in err


def test_drives_of_cia_402_are_found_tested_and_switched_off(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    text = description_text("cobra").replace('protocol = "rmd-v1"', 'protocol = "cia402"')
    robot = tmp_path / "cobra.toml"
    robot.write_text(text.replace("encoder_bits = 14", "encoder_bits = 12"), "utf-8")
    drives = Drives(tmp_path, "--robot", str(robot), "--slcan", "tcp:0", "--twin", "none")
    try:
        adapter = f"{drives.channels['main']}?sleep_after_open=0"
        route = ("--robot", str(robot), "--bus", f"main=slcan:{adapter}")
        status, out, err = teleop(capsys, "motors", "scan", *route)
        assert status == 0, out + err
        assert [line.split()[2:5] for line in out.splitlines()[1:3]] == [["S1", "CiA", "402"], ["E1", "CiA", "402"]]
        assert len(out.splitlines()) == 15
        assert out.splitlines()[1].endswith("  none (state switch on disabled)")
        status, out, err = teleop(capsys, "motors", "test", "feed", *route)
        assert status == 0, out + err
        assert "went in, then out by 3.0 mm" in out
        drives.make("overheat E1 95")
        status, out, err = teleop(capsys, "motors", "test", "E1", *route)
        assert status == 2
        assert "E1" in err
        assert "95" in err or "temperature" in err
        drives.make("heal")
        status, out, err = teleop(capsys, "motors", "off", *route)
        assert (status, out, err) == (0, "all drives of cobra are off\n", "")
    finally:
        drives.end()


def test_a_fault_on_the_way_ends_it_in_one_line(served: Drives, capsys: pytest.CaptureFixture[str]) -> None:
    route = ("--bus", f"main=slcan:{served.channels['main']}?sleep_after_open=0")
    served.make("stall N1")
    status, _, err = teleop(capsys, "motors", "identify", "N1", "--degrees", "60", *route)
    served.make("heal")
    assert status == 2
    assert "cobra-teleop: ended: drive N1" in err
    assert "motors off" in err
    assert "Traceback" not in err
    status, out, _ = teleop(capsys, "motors", "off", *route)
    assert (status, out) == (0, "all drives of cobra are off\n")


def test_who_owns_the_motors_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    runtime.register("robot", "cobra", "tcp/127.0.0.1:1")
    status, _, err = teleop(capsys, "motors", "identify", "S1", "--bus", "main=socketcan:can0")
    assert status == 2
    assert "the robot process of cobra runs" in err
    assert "owns the motors" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("identify", "S9", "--twin", "none"), "cobra has no drive 'S9'"),
        (("identify", "S1", "--twin", "none", "--degrees", "400"), "--degrees 400: must be over 0 and at most 90"),
        (("home", "--runs", "0"), "--runs 0: must be 1 to 10"),
        (("tare", "--twin", "none"), "cobra has no load cells"),
        (("scan", "--interface", "socketcan"), "give both"),
        (("scan", "--interface", "socketcan", "--channel", "can9"), "cannot be opened"),
    ],
)
def test_what_cannot_be_is_one_line(capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str) -> None:
    status, _, err = teleop(capsys, "motors", *arguments)
    assert status == 2
    assert words in err
    assert err.count("\n") == 1


@pytest.mark.long
def test_a_robot_is_homed_three_times_and_its_zeros_are_kept(tmp_path: Path) -> None:
    """A process of its own, as a user runs it, on a twin in real time."""
    command = [sys.executable, "-m", "app", "motors"]
    done = subprocess.run([*command, "home"], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert "largest spread 0." in done.stdout
    listed = subprocess.run([*command, "calibrations"], capture_output=True, text=True, check=True, timeout=60)
    assert "*    1" in listed.stdout
    assert "14 zeros" in listed.stdout
