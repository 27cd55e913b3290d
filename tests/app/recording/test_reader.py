"""Claims about reading: whatever can be shown is shown, and what is wrong is told in one line, whatever the file is."""

import contextlib
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import Writer

from app.recording import channels, recover
from app.recording.container import RecordingError
from app.recording.mcap_file import McapFile, Topic
from app.recording.reader import Recording
from cobra.messages import Event
from tests.recordings import BEGIN_NS, START_S, facts, moving, same, write

EVENTS = [
    Event(stamp=START_S + 0.5, level="info", text="ready"),
    Event(stamp=START_S + 2.0, level="alarm", text="STOP by ada"),
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "whole.mcap"
    write(path, 4.0, events=EVENTS)
    return path


@pytest.fixture(scope="module")
def chunked(tmp_path_factory) -> tuple[Path, list]:
    """A recording of many small chunks, as on a robot, but never closed."""
    path = tmp_path_factory.mktemp("chunked") / "chunked.mcap"
    file = McapFile(path, [Topic("/state", "cobra.RobotState", b"{}")], durable=False)
    given = facts()
    file.start({"format": "1", "robot": "cobra", "title": "COBRA"})
    file.attach(channels.DESCRIPTION, "application/toml", given.attachments[channels.DESCRIPTION], BEGIN_NS)
    states = [moving(i / 50) for i in range(100)]
    for i, state in enumerate(states):
        file.add("/state", BEGIN_NS + i * 20_000_000, 0, channels.encode(state), i)
        if i % 10 == 9:
            file.flush()
    file.close()
    return path, states


def test_the_state_at_a_time_is_the_newest_until_then(chunked):
    path, states = chunked
    with Recording(path) as recording:
        for t in (0.0, 0.019, 0.02, 0.199, 0.2, 1.234, 1.98):
            state = recording.state_at(t)
            assert state is not None
            assert same(state, states[int(t / 0.02 + 1e-6)])
        before, after = recording.state_at(-5.0), recording.state_at(99.0)
        assert before is not None
        assert after is not None
        assert same(before, states[0])
        assert same(after, states[-1])


def test_the_digest_tells_who_drove_how_far_and_what_happened(whole):
    with Recording(whole) as recording:
        digest = recording.digest
        assert [(span.what, round(span.end_s, 2)) for span in digest.drivers] == [("ada", 3.98)]
        assert digest.driving_s == pytest.approx(2.96, abs=0.03)
        assert digest.counts == {"info": 1, "alarm": 1}
        assert [event.text for event in digest.events] == ["ready", "STOP by ada"]
        assert digest.refused == {"too old": 20}
        assert max(digest.max_tension_N.values()) == pytest.approx(15.0, abs=0.05)
        assert max(digest.overview.tension_N) == pytest.approx(15.0, abs=0.05)
        # The tip's way, by an independent sum over the recorded states at the digest's own step.
        assert 0.3 < digest.path_m < 30.0


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_cut_anywhere_what_was_whole_is_shown_and_nothing_else(chunked, tmp_path, data):
    path, states = chunked
    content = path.read_bytes()
    length = data.draw(st.integers(0, len(content)), label="length")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(content[:length])
    recording = Recording(cut)
    try:
        recording.open()
    except RecordingError as error:
        refused = str(error)
    else:
        refused = ""
    if refused:
        assert "\n" not in refused
        assert str(cut) in refused
        assert length < len(content) / 2, "the first chunk was not whole"
        return
    read = [state for _, state in recording.states()]
    assert any("not closed" in warning for warning in recording.warnings)
    recording.close()
    assert all(same(one, other) for one, other in zip(read, states, strict=False))
    assert len(read) % 10 == 0


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_a_flipped_byte_never_invents_a_state(whole, tmp_path, data):
    content = bytearray(whole.read_bytes())
    place = data.draw(st.integers(0, len(content) - 1), label="place")
    content[place] ^= 1 << data.draw(st.integers(0, 7), label="bit")
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(content)
    with Recording(whole) as recording:
        good = {state.tick: state for _, state in recording.states()}
    with contextlib.suppress(RecordingError), Recording(bad) as recording:
        for _, state in recording.states():
            assert same(state, good[state.tick])
        recording.state_at(1.0)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"tick,phase\n1,ready\n", "not a recording"),
        (b"\x89MCAP0\r\n", "another program"),
        (b"\x89MCAP0\r\n" + bytes(500), "another program"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, content, words):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=words) as raised:
        Recording(path).open()
    assert "\n" not in str(raised.value)
    with pytest.raises(RecordingError, match="cannot be opened"):
        Recording(tmp_path / "none.mcap").open()


def test_an_mcap_file_of_another_program_is_refused(tmp_path):
    with (tmp_path / "ros.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros1")
        writer.finish()
    with pytest.raises(RecordingError, match=r"another program \(profile 'ros1'\)"):
        Recording(tmp_path / "ros.mcap").open()


def test_a_newer_version_is_shown_as_far_as_it_is_understood(tmp_path):
    file = McapFile(
        tmp_path / "new.mcap", [Topic("/state", "cobra.RobotState", b"{}"), Topic("/smell", "x", b"{}")], durable=False
    )
    given = facts()
    file.start({"format": "9", "robot": "cobra", "title": "COBRA"})
    file.attach(channels.DESCRIPTION, "application/toml", given.attachments[channels.DESCRIPTION], BEGIN_NS)
    for i in range(20):
        tree = msgspec.json.decode(channels.encode(moving(i / 50)))
        tree["aura"] = {"colour": "red"}
        file.add("/state", BEGIN_NS + i * 20_000_000, 0, msgspec.json.encode(tree), i)
        file.add("/smell", BEGIN_NS + i * 20_000_000, 0, b'{"roses": 1}', i)
    file.finish()
    file.close()
    with Recording(tmp_path / "new.mcap") as recording:
        assert len(list(recording.states())) == 20
        (newer,) = (warning for warning in recording.warnings if "newer" in warning)
        assert "format 9" in newer
        for missing in ("/event", "/command", "/input"):
            assert any(f"no channel {missing}" in warning for warning in recording.warnings)
        assert recording.digest.states == 20


def test_without_a_usable_description_there_are_numbers_and_no_scene(tmp_path):
    given = facts(text="[robot\nnonsense")
    write(tmp_path / "a.mcap", 1.0, given=given)
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.description is None
        assert any("no 3D view" in warning for warning in recording.warnings)
        assert len(list(recording.states())) == 50


def test_recovering_gives_a_closed_file_with_everything_that_was_whole(chunked, tmp_path):
    path, states = chunked
    content = path.read_bytes()
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(content[:-300])
    told = recover.recover(broken, tmp_path / "clean.mcap")
    assert told.lost_bytes > 0
    assert "bytes were not whole" in told.words
    with Recording(tmp_path / "clean.mcap") as recording:
        assert recording.closed
        read = [state for _, state in recording.states()]
        assert len(read) == 90
        assert all(map(same, read, states))
        assert recording.digest.states == 90
        assert recording.digest.recovered == told.words
        assert not any("not closed" in warning for warning in recording.warnings)


def test_recovering_leaves_out_a_damaged_chunk_and_says_so(chunked, tmp_path):
    path, _ = chunked
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    (tmp_path / "hurt.mcap").write_bytes(content)
    told = recover.recover(tmp_path / "hurt.mcap", tmp_path / "clean.mcap")
    assert told.damaged_chunks == 1
    assert told.missed == 10
    assert "1 damaged chunk" in told.words
    assert "10 ticks" in told.words


def test_recovering_overwrites_nothing(chunked, tmp_path):
    (tmp_path / "there.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists already"):
        recover.recover(chunked[0], tmp_path / "there.mcap")
    assert (tmp_path / "there.mcap").read_bytes() == b"precious"
