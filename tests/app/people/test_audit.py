"""Who took, drove, stopped and cleared is written down, for good, and without secrets."""

import stat

import pytest

from app.people.audit import AuditTrail, read
from app.robot_deeds import RobotDeeds
from cobra.messages import Answered, Drives, Heard, Lease, Reply, Request, RobotState, Stop, encode

NO_DRIVES = Drives(travel=(), setpoint=(), velocity=(), load=(), temperature=(), voltage=(), age=(), valid=(), fault=())


def state(phase: str, stamp: float, holder: str = "anna", cause: str = "") -> RobotState:
    lease = Lease(holder=holder, fresh=bool(holder))
    return RobotState(robot="cobra", stamp=stamp, tick=0, phase=phase, lease=lease, cause=cause, drives=NO_DRIVES)


def asked(what: str, who: str = "anna", ok: bool = True, **fields) -> Heard:
    reply = Reply(ok=ok, reasons=() if ok else ("no",), lease="fedcba98")
    return Heard(
        answers=(Answered(stamp=1.0, request=Request(what=what, who=who, lease="abcd", **fields), reply=reply),)
    )


@pytest.fixture
def trail(tmp_path):
    trail = AuditTrail("cobra", tmp_path)
    trail.start()
    yield trail
    trail.stop()


def test_a_drive_from_taking_the_controls_to_clearing_the_stop(trail, tmp_path):
    deeds = RobotDeeds(trail)
    deeds.heard(asked("acquire"))
    deeds.heard(asked("arm"))
    deeds.heard(asked("retain"))
    for phase, stamp in (("ready", 1.0), ("driving", 2.0), ("driving", 3.0), ("ready", 4.5), ("driving", 5.0)):
        deeds.state(state(phase, stamp))
    for _ in range(3):  # said again until it is confirmed
        deeds.stopped(encode(Stop(who="vic", reason="pressed on page 2", press="a1")))
    deeds.state(state("stopped", 6.0, holder="", cause="STOP by vic"))
    deeds.heard(asked("clear", who="bob", ok=False))
    deeds.heard(asked("clear"))
    deeds.stopped(b"\xc1")
    deeds.state(state("driving", 7.0))
    deeds.state(state("ready", 8.0, cause="page 1 fell silent"))
    trail.stop()
    (file,) = tmp_path.iterdir()
    written = [(deed.who, deed.what, deed.detail) for deed in read(file)]
    assert written == [
        ("anna", "took the controls", ""),
        ("anna", "armed", ""),
        ("anna", "drove 2.5 s", ""),
        ("vic", "STOP", "pressed on page 2"),
        ("anna", "drove 1.0 s", "STOP by vic"),
        ("bob", "was refused: clear", "no"),
        ("anna", "cleared the stop", ""),
        ("somebody", "STOP", "the message was damaged"),
        ("anna", "drove 1.0 s", "page 1 fell silent"),
    ]
    assert stat.S_IMODE(file.stat().st_mode) == 0o600
    assert not any(secret in file.read_text() for secret in ("abcd", "fedcba98"))
    assert read(file)[0].time.endswith("Z")


def test_two_processes_write_one_file_and_a_new_one_reads_on(trail, tmp_path):
    other = AuditTrail("cobra", tmp_path)
    other.start()
    for number in range(50):
        trail.note("anna", f"deed {number}")
        other.note("bob", f"deed {number}")
    trail.stop()
    other.stop()
    again = AuditTrail("cobra", tmp_path)
    again.start()
    assert len(again.tail()) == 100
    assert {deed.who for deed in again.tail()} == {"anna", "bob"}
    again.stop()


def test_a_disk_that_fails_is_counted_and_stops_nobody(trail, tmp_path):
    trail._folder = tmp_path / "gone"
    for _ in range(3):
        trail.note("anna", "armed")
    trail.stop()
    assert trail.lost == 3
    assert len(trail.tail()) == 3


def test_damaged_lines_are_passed_over(tmp_path):
    file = tmp_path / "audit.jsonl"
    file.write_bytes(
        b'{"time":"t","who":"a","what":"w"}\n{"time":\n\xff\n{"time":"t","who":"b","what":"w","detail":""}\n'
    )
    assert [deed.who for deed in read(file)] == ["a", "b"]
