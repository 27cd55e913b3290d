"""Claims about the writer: what is put in is in the file, bit by bit; a bad disk costs messages, never the session."""

import math
import threading
import time
from typing import Any

import msgspec
import numpy as np
import pytest
from mcap.reader import make_reader

from app.recording import channels, mcap_file, storage
from app.recording.foxglove import JOINTS, LOG, SCENE
from app.recording.mcap_file import McapFile
from app.recording.reader import Recording
from app.recording.writer import SessionWriter
from cobra.kinematics.backbone import Backbone
from cobra.messages import Calibration, DriveCalibration, Event, encode
from tests.recordings import BEGIN_NS, COBRA, START_S, Disk, facts, moving, same, write
from tests.stack import wait_for

ALARM = Event(stamp=START_S + 1.25, level="alarm", text="STOP by ada")

REQUIRED = {
    "SceneUpdate": {"deletions", "entities"},
    "SceneEntity": {"timestamp", "frame_id", "id", "lifetime", "frame_locked", "metadata", "arrows", "cubes", "spheres"}
    | {"cylinders", "lines", "triangles", "texts", "models"},
    "LinePrimitive": {"type", "pose", "thickness", "scale_invariant", "points", "color", "colors", "indices"},
    "JointStates": {"timestamp", "joints"},
    "Log": {"timestamp", "level", "message", "name", "file", "line"},
}
"""By Foxglove's published JSON schemas (foxglove-sdk, schemas/jsonschema)."""
QUANTITIES = {"position", "velocity", "acceleration", "effort"}
"""Of a joint, each a number or left out."""


def test_every_state_is_in_the_file_bit_by_bit(tmp_path):
    unknown = (math.nan,) * 14

    def without_feedback(state):
        drives = msgspec.structs.replace(state.drives, load=unknown, temperature=unknown)
        return msgspec.structs.replace(state, drives=drives) if state.tick < 10 else state

    written = write(tmp_path / "a.mcap", change=without_feedback)
    with Recording(tmp_path / "a.mcap") as recording:
        read = [state for _, state in recording.states()]
        assert len(read) == len(written)
        assert all(map(same, read, written))
        assert recording.warnings == []
        assert recording.unreadable == 0


def test_times_keep_the_robots_own_intervals_whatever_the_link_does(tmp_path):
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    for i in range(100):
        late_ns = (i * 7919) % 40_000_000 if i else 0
        writer.put("state", BEGIN_NS + i * 20_000_000 + late_ns, encode(moving(i / 50)))
    writer.stop()
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.start_ns == BEGIN_NS
        assert [t for t, _ in recording.states()] == pytest.approx([i / 50 for i in range(100)], abs=1e-6)


def test_commands_carry_their_verdict_and_events_their_level(tmp_path):
    write(tmp_path / "a.mcap", events=[ALARM])
    with Recording(tmp_path / "a.mcap") as recording:
        commands = list(recording.commands())
        assert [judged.dropped for _, judged in commands] == ["" if i % 10 else "too old" for i in range(150)]
        assert {(judged.command.lease, judged.command.epoch) for _, judged in commands} == {("abcd0123", 3)}
        ((time_s, event),) = recording.events()
        assert (time_s, event) == (pytest.approx(1.25, abs=1e-6), ALARM)
        sticks = [reading.left[0] for _, reading in recording.inputs()]
        assert sticks == [0.0] * 51 + [0.5] * 99


def test_any_mcap_reader_opens_it_and_its_checksums_hold(tmp_path):
    written = write(tmp_path / "a.mcap", events=[ALARM])
    with (tmp_path / "a.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        messages = list(reader.iter_messages())
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == len(messages)
        counts = {summary.channels[number].topic: n for number, n in summary.statistics.channel_message_counts.items()}
        assert counts["/state"] == len(written)
        assert counts["/event"] == 1
        names = {attachment.name for attachment in reader.iter_attachments()}
        assert names >= {"description.toml", "versions.json", "settings.json", "digest.json"}


def test_every_message_fits_its_own_schema(tmp_path):
    write(tmp_path / "a.mcap", events=[ALARM])
    seen = set()
    with (tmp_path / "a.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            assert schema.encoding == "jsonschema"
            _check(msgspec.json.decode(message.data), msgspec.json.decode(schema.data), channel.topic)
            seen.add(channel.topic)
    assert seen >= {"/state", "/command", "/event", "/input", "/recorder", SCENE, JOINTS, LOG}


def test_a_joint_of_which_nothing_is_known_has_no_position_for_foxglove(tmp_path):
    unknown = (math.nan,) * 14
    write(tmp_path / "a.mcap", 0.1, change=lambda state: msgspec.structs.replace(
        state, drives=msgspec.structs.replace(state.drives, travel=unknown, load=unknown)))  # fmt: skip
    with (tmp_path / "a.mcap").open("rb") as file:
        _, _, message = next(make_reader(file).iter_messages(topics=[JOINTS]))
    joints = {joint["name"]: joint for joint in msgspec.json.decode(message.data)["joints"]}
    assert set(joints["drive feed"]) == {"name", "velocity"}
    assert "position" in joints["measured feed"]


def test_foxglove_finds_the_backbone_the_joints_and_the_alarm(tmp_path):
    written = write(tmp_path / "a.mcap", events=[ALARM])
    found: dict[str, Any] = {}
    with (tmp_path / "a.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            found.setdefault(channel.topic, (schema.name, msgspec.json.decode(message.data)))
    name, scene = found[SCENE]
    (entity,) = scene["entities"]
    assert REQUIRED["SceneUpdate"] <= set(scene)
    assert REQUIRED["SceneEntity"] <= set(entity)
    assert all(REQUIRED["LinePrimitive"] == set(line) for line in entity["lines"])
    backbone = scene["entities"][0]["lines"][0]
    assert name == "foxglove.SceneUpdate"
    expected = Backbone(COBRA).tip(np.array(written[0].measured))[:3, 3]
    last = backbone["points"][-1]
    assert (last["x"], last["y"], last["z"]) == pytest.approx(tuple(expected), abs=1e-5)
    name, joints = found[JOINTS]
    assert name == "foxglove.JointStates"
    assert REQUIRED["JointStates"] == set(joints)
    assert all({"name"} <= set(joint) <= {"name", *QUANTITIES} for joint in joints["joints"])
    positions = {joint["name"]: joint["position"] for joint in joints["joints"]}
    assert positions["measured feed"] == written[0].measured[1]
    assert positions["drive feed"] == written[0].drives.travel[-1]
    name, line = found[LOG]
    assert REQUIRED["Log"] == set(line)
    assert (name, line["level"], line["message"]) == ("foxglove.Log", 4, "STOP by ada")


def test_a_full_disk_loses_messages_counts_them_says_so_and_goes_on(tmp_path, monkeypatch):
    disk = Disk(40_000)
    monkeypatch.setattr(mcap_file.os, "write", disk.write)
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    for i in range(50):
        writer.put("state", BEGIN_NS + i * 20_000_000, encode(moving(i / 50)))
    wait_for("a complaint about the disk", lambda: "No space left" in writer.status.problem)
    lost = writer.status.dropped
    assert lost >= 50
    disk.room = 10**9
    for i in range(50, 100):
        writer.put("state", BEGIN_NS + i * 20_000_000, encode(moving(i / 50)))
    wait_for("the disk to take it again", lambda: not writer.status.problem and writer.status.written >= 50)
    writer.stop()
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.closed
        assert [state.tick for _, state in recording.states()] == list(range(50, 100))
        assert recording.digest.dropped == writer.status.dropped


def test_a_disk_that_hangs_holds_up_nobody(tmp_path):
    free = threading.Event()

    class Hanging(McapFile):
        def flush(self) -> None:
            free.wait(30.0)
            super().flush()

    writer = SessionWriter(tmp_path / "a.mcap", facts(), capacity=100, make_file=Hanging)
    writer.start()
    writer.put("state", BEGIN_NS, encode(moving(0.0)))
    wait_for("the first chunk", lambda: time.monotonic() - writer._progress_s > 0.2)
    for i in range(1, 301):
        writer.put("state", BEGIN_NS + i * 20_000_000, encode(moving(i / 50)))
    assert writer.status.dropped == 200
    wait_for("a complaint", lambda: "taken nothing" in writer.status.problem)
    free.set()
    writer.stop()
    with Recording(tmp_path / "a.mcap") as recording:
        assert len(list(recording.states())) == 101
        assert recording.digest.dropped == 200


def test_what_cannot_be_decoded_is_counted_and_the_rest_recorded(tmp_path):
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    writer.put("state", BEGIN_NS, b"\xff\xfe")
    writer.put("event", BEGIN_NS, b"")
    writer.put("state", BEGIN_NS, encode(moving(0.0)))
    wait_for("the good one", lambda: writer.status.written >= 1)
    assert writer.status.unreadable == 2
    writer.stop()


def test_states_that_the_link_dropped_are_counted(tmp_path):
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    for tick in (0, 1, 2, 7, 8):
        writer.put("state", BEGIN_NS + tick * 20_000_000, encode(moving(tick / 50)))
    writer.stop()
    assert writer.status.missed == 4
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.digest.missed == 4


def test_a_file_being_written_is_locked_until_its_writer_ends(tmp_path):
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    assert storage.being_written(tmp_path / "a.mcap")
    writer.stop()
    assert not storage.being_written(tmp_path / "a.mcap")


def test_each_calibration_in_force_is_attached_and_the_last_one_counts(tmp_path):
    writer = SessionWriter(tmp_path / "a.mcap", facts())
    writer.start()
    drives = {"E1": DriveCalibration(travel_per_rad=0.01, load_per_A=50.0)}
    hours_old = Calibration(stamp=START_S - 9000.0, homed=False, drives=drives)
    zero = msgspec.structs.replace(drives["E1"], zero_rad=1.25)
    homed = Calibration(stamp=START_S + 0.5, homed=True, drives={"E1": zero})
    for calibration in (hours_old, hours_old):
        writer.put("calibration", BEGIN_NS, encode(calibration))
    for i in range(50):
        writer.put("state", BEGIN_NS + i * 20_000_000, encode(moving(i / 50)))
    writer.put("calibration", BEGIN_NS + 500_000_000, encode(homed))
    writer.stop()
    with Recording(tmp_path / "a.mcap") as recording:
        assert channels.decode(recording.attachments["calibration.json"], Calibration) == homed
        assert recording.start_ns == BEGIN_NS, "what was told first is no clock"
        assert len(list(recording.states())) == 50
    with (tmp_path / "a.mcap").open("rb") as file:
        attached = [entry for entry in make_reader(file).iter_attachments() if entry.name == "calibration.json"]
    assert [entry.log_time - BEGIN_NS for entry in attached] == [0, 500_000_000]


def test_a_recording_never_takes_the_place_of_another(tmp_path):
    write(tmp_path / "a.mcap", 0.1)
    with pytest.raises(FileExistsError):
        SessionWriter(tmp_path / "a.mcap", facts()).start()


def test_an_unknown_type_is_refused_when_the_schema_is_made():
    class Odd(msgspec.Struct):
        either: int | str

    with pytest.raises(TypeError, match="no plain schema"):
        channels.schema(Odd)


def _check(value: Any, schema: dict[str, Any], where: str) -> None:
    """A JSON Schema validator of just the words that are used; null: a number that is not known, or nothing."""
    kinds = {"object": dict, "array": list, "string": str, "boolean": bool, "integer": int, "number": (int, float)}
    if value is None:
        assert schema["type"] in ("number", "object"), where
        return
    assert isinstance(value, kinds[schema["type"]]), f"{where}: {value!r} is no {schema['type']}"
    if "enum" in schema:
        assert value in schema["enum"], where
    for name, entry in schema.get("properties", {}).items():
        assert isinstance(value, dict)
        if name in QUANTITIES and name not in value:
            continue
        assert name in value, f"{where}.{name} is missing"
        _check(value[name], entry, f"{where}.{name}")
    if schema["type"] == "array":
        for entry in value:
            _check(entry, schema["items"], f"{where}[]")
