"""Claims about playing: time goes on at the chosen speed, stops at the end, and can be set."""

import pytest

from app.recording.player import Player
from app.recording.reader import Recording
from cobra.clock import ManualClock
from tests.recordings import moving, write


@pytest.fixture
def two(tmp_path):
    write(tmp_path / "a.mcap", 10.0)
    write(tmp_path / "b.mcap", 4.0)
    with Recording(tmp_path / "a.mcap") as a, Recording(tmp_path / "b.mcap") as b:
        clock = ManualClock()
        yield Player((a, b), clock), clock


def test_it_waits_until_it_is_played_and_keeps_the_chosen_speed(two):
    player, clock = two
    clock.advance(5.0)
    assert player.time_s == 0.0
    player.play()
    clock.advance(1.0)
    assert player.time_s == pytest.approx(1.0)
    player.set_speed(5.0)
    clock.advance(1.0)
    assert player.time_s == pytest.approx(6.0)
    player.pause()
    clock.advance(3.0)
    assert player.time_s == pytest.approx(6.0)
    state = player.state()
    assert state is not None
    assert state.tick == moving(6.0).tick


def test_it_stops_at_the_end_and_starts_over_from_there(two):
    player, clock = two
    player.play()
    clock.advance(60.0)
    assert not player.playing
    assert player.time_s == player.duration_s
    player.play()
    assert player.time_s == 0.0
    assert player.playing


@pytest.mark.parametrize(("asked", "given"), [(-3.0, 0.0), (3.5, 3.5), (1e5, 9.98)])
def test_time_stays_within_the_recording(two, asked, given):
    player, _ = two
    player.seek(asked)
    assert player.time_s == pytest.approx(given, abs=1e-6)


def test_the_other_recording_runs_beside_it_and_is_gone_where_it_has_nothing(two):
    player, _ = two
    player.seek(2.0)
    other = player.other_state()
    assert other is not None
    assert other.tick == 100
    player.set_offset(-1.0)
    other = player.other_state()
    assert other is not None
    assert other.tick == 50
    player.seek(0.5)
    assert player.other_state() is None
    player.seek(9.0)
    assert player.other_state() is None
