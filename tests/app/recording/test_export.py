"""Claims about exports: the numbers are those of the recording, and what is shared needs nothing else."""

import csv
import json
import re
import subprocess
import sys

import numpy as np
import pyarrow.parquet as pq
import pytest

from app.recording import export as exports
from app.recording import storage
from app.recording.container import RecordingError
from app.recording.export import export
from app.recording.storage import Notes
from cobra.messages import Event
from tests.recordings import BEGIN_NS, START_S, facts, write

EVENTS = [
    Event(stamp=START_S + 0.5, level="marker", text="<script>blade 7</script>"),
    Event(stamp=START_S + 1.5, level="alarm", text="STOP by ada"),
]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("session") / "s.mcap"
    return path, write(path, 2.0, events=EVENTS)


def test_csv_parquet_and_npz_hold_the_same_numbers_as_the_recording(session, tmp_path):
    path, states = session
    export(path, ("csv", "parquet", "npz"), ("state", "event"), tmp_path)
    with (tmp_path / "state.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    parquet = pq.read_table(tmp_path / "state.parquet").to_pydict()
    npz = np.load(tmp_path / "data.npz")
    assert len(rows) == len(states) == len(npz["state.time_s"]) == len(parquet["time_s"])
    for name, expected in (
        ("measured.feed", [state.measured[1] for state in states]),
        ("measured.tip_x", [state.measured[6] for state in states]),
        ("drives.load.E1", [state.drives.load[1] for state in states]),
        ("tick", [state.tick for state in states]),
        ("phase", [state.phase for state in states]),
    ):
        assert parquet[name] == expected
        assert npz[f"state.{name}"].tolist() == expected
        assert [row[name] for row in rows] == [str(value) for value in expected]
    assert npz["state.time_ns"][0] == BEGIN_NS
    assert npz["event.text"].tolist() == [event.text for event in EVENTS]


def test_chosen_parts_only(session, tmp_path):
    path, _ = session
    export(path, ("npz",), ("state.drives.load", "command.dropped"), tmp_path)
    names = set(np.load(tmp_path / "data.npz"))
    assert {name.split(".")[0] for name in names} == {"state", "command"}
    assert "state.drives.load.E1" in names
    assert "state.measured.feed" not in names
    assert {"command.dropped", "command.time_s"} <= names


@pytest.mark.parametrize(
    ("wanted", "words"), [("smell", "no channel 'smell'; there are state"), ("state.aura", "no column")]
)
def test_what_there_is_not_is_told_with_what_there_is(session, tmp_path, wanted, words):
    with pytest.raises(RecordingError, match=words):
        export(session[0], ("csv",), (wanted,), tmp_path)


def test_without_pyarrow_it_says_what_to_install(session, tmp_path, monkeypatch):
    monkeypatch.setattr(exports, "find_spec", lambda name: None)
    with pytest.raises(RecordingError, match=r"cobra-teleop\[parquet\]"):
        export(session[0], ("parquet",), (), tmp_path)


def test_the_report_tells_the_session_and_runs_nothing_that_people_wrote(session, tmp_path):
    path, _ = session
    storage.write_notes(path, Notes(note="stuck at <b>blade 7</b>"))
    export(path, ("report", "png"), (), tmp_path)
    page = (tmp_path / "report.html").read_text()
    for words in (
        "driver changes",
        "path of the tip",
        "STOP by ada",
        "highest tension",
        "&lt;script&gt;",
        "&lt;b&gt;blade",
    ):
        assert words in page
    assert "<script" not in page
    assert not re.search(r'(src|href)="(?!data:)', page), "it needs nothing from elsewhere"
    assert page.count("data:image/png") == 4
    for name in ("shape", "tensions", "tip", "timing"):
        assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def export_size_of_one_state(folder) -> int:
    write(folder / "still.mcap", 0.02)
    export(folder / "still.mcap", ("viser",), (), folder / "still")
    return (folder / "still" / "scene.viser.html").stat().st_size


def test_the_scene_is_one_file_with_the_motion_inside(session, tmp_path):
    export(session[0], ("viser",), (), tmp_path)
    page = (tmp_path / "scene.viser.html").read_text()
    assert page.lower().startswith("<!doctype html>")
    still = export_size_of_one_state(tmp_path)
    assert len(page) > still + 100_000, "thirty frames of motion are in it"
    assert not re.findall(r'<(?:script|link)[^>]+(?:src|href)="https?:', page)


def test_without_a_description_tables_still_come(tmp_path):
    write(tmp_path / "s.mcap", 0.5, given=facts(text="[nonsense"))
    export(tmp_path / "s.mcap", ("npz", "report"), (), tmp_path / "out")
    data = np.load(tmp_path / "out" / "data.npz")
    assert len(json.loads(data["state.measured"][0])) == 8
    assert (tmp_path / "out" / "report.html").exists()
    with pytest.raises(RecordingError, match="no scene"):
        export(tmp_path / "s.mcap", ("viser",), (), tmp_path / "out")


def test_the_command_names_what_it_wrote(session, tmp_path):
    command = [sys.executable, "-m", "app", "export", str(session[0]), "--to", "npz", "--out", str(tmp_path / "x")]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == f"{tmp_path / 'x' / 'data.npz'}\n"
