"""The log of every frame: read back by python-can's own readers."""

import random
import time
from pathlib import Path

import can
import numpy as np
import pytest

from cobra.motors.bus import BusError
from cobra.motors.raw_log import RawLog
from tests.cobra.motors.handmade_drives import plain


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_every_frame_is_in_the_file_in_order_with_its_direction(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"can{suffix}"
    rng = np.random.default_rng(1)
    frames = [plain(0x141 + i % 14, rng.bytes(8)) for i in range(3000)]
    with RawLog(path) as log:
        record = log.recorder("main")
        for i, frame in enumerate(frames):
            record(frame, bool(i % 2))
    back = list(can.LogReader(path))
    assert [(f.arbitration_id, bytes(f.data), f.is_rx) for f in back] == [
        (f.arbitration_id, bytes(f.data), bool(i % 2)) for i, f in enumerate(frames)
    ]
    assert (log.written, log.dropped) == (3000, 0)


def test_frames_are_copied_since_messages_are_used_again(tmp_path: Path) -> None:
    message = plain(0x141, bytes(8))
    with RawLog(tmp_path / "can.log") as log:
        record = log.recorder("main")
        for value in range(5):
            message.data[0] = value
            record(message, False)
    assert [frame.data[0] for frame in can.LogReader(tmp_path / "can.log")] == [0, 1, 2, 3, 4]


def test_channels_have_their_names_in_a_candump_log(tmp_path: Path) -> None:
    with RawLog(tmp_path / "can.log") as log:
        for name in ("main", "base"):
            log.recorder(name)(plain(0x141, "A4 00 F4 01 A0 8C 00 00"), False)
    lines = (tmp_path / "can.log").read_text().splitlines()
    assert [line.split()[1:3] for line in lines] == [["main", "141#A400F401A08C0000"], ["base", "141#A400F401A08C0000"]]


def test_a_full_queue_drops_and_counts_instead_of_growing_or_waiting(tmp_path: Path) -> None:
    log = RawLog(tmp_path / "can.log", capacity=10)
    record = log.recorder("main")
    for _ in range(25):
        record(plain(0x141, bytes(8)), True)
    assert log.dropped == 15
    log.start()
    log.stop()
    assert log.written == 10


def test_a_full_disk_ends_the_log_and_not_the_robot(tmp_path: Path) -> None:
    full = Path("/dev/full")
    if not full.exists():
        pytest.skip("no /dev/full on this system")
    link = tmp_path / "can.log"
    link.symlink_to(full)
    log = RawLog(link)
    record = log.recorder("main")
    log.start()
    for _ in range(2000):
        record(plain(0x141, bytes(8)), True)
    log.stop()
    record(plain(0x141, bytes(8)), True)
    assert log.dropped > 0


def test_the_frames_of_a_robot_process_before_are_kept(tmp_path: Path) -> None:
    for value in (1, 2):
        with RawLog(tmp_path / "can.log") as log:
            log.recorder("main")(plain(0x141, bytes([value] * 8)), False)
    (aside,) = tmp_path.glob("can-*.log")
    assert [next(iter(can.LogReader(path))).data[0] for path in (aside, tmp_path / "can.log")] == [1, 2]


@pytest.mark.parametrize(
    ("name", "words"),
    [("can.db", r"must be named \*\.log or \*\.blf"), ("missing/can.log", "cannot be written: No such file")],
)
def test_a_log_that_cannot_be_is_one_clear_line(tmp_path: Path, name: str, words: str) -> None:
    with pytest.raises(BusError, match=words):
        RawLog(tmp_path / name).start()


@pytest.mark.parametrize("suffix", [".log", ".blf"])
def test_a_file_that_has_grown_is_put_aside_no_frame_is_lost_and_the_oldest_go(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"can{suffix}"
    (tmp_path / f"can-yesterday{suffix}").write_text("not ours")
    frame = can.Message(arbitration_id=0x141, is_extended_id=False, data=b"12345678")
    with RawLog(path, max_bytes=2000, kept=3) as log:
        record = log.recorder("main")
        for k in range(8):
            frame.data[:] = random.Random(k).randbytes(8)
            for _ in range(400):
                record(frame, True)
            wanted = (k + 1) * 400
            deadline = time.monotonic() + 20.0
            while log.written < wanted and time.monotonic() < deadline:
                time.sleep(0.01)
        assert log.written == 3200
    aside = sorted(tmp_path.glob(f"can-*-*-????{suffix}"))
    assert len(aside) == 3
    assert (tmp_path / f"can-yesterday{suffix}").exists()
    kept = [*aside, path]
    frames = [bytes(frame.data) for each in kept for frame in can.LogReader(each)]
    last = random.Random(7).randbytes(8)
    assert frames.count(last) == 400
    assert len(frames) % 400 == 0
