"""Faults on request: what is said does happen to the simulated robot, and what cannot be is one line."""

from collections.abc import Iterator

import can
import numpy as np
import pytest

from cobra.clock import ManualClock
from cobra.simulation.drives import world_of
from cobra.simulation.faults import FAULTS, FaultDesk, FaultError
from cobra.simulation.twin import Twin


@pytest.fixture(params=["off", "nominal"])
def desk(request: pytest.FixtureRequest) -> Iterator[FaultDesk]:
    """On a twin without and with friction, its tendons wound in by a few millimetres."""
    options = {"stepping": "inline", "clock": ManualClock(), "losses": request.param}
    with can.Bus(interface="cobra-sim", channel="cobra", **options):
        twin = world_of("cobra").plant
        twin.advance(np.array([-0.004] * 12 + [0.0, 0.3]), 0.05)
        yield FaultDesk("cobra")


def tension(name: str) -> float:
    twin = world_of("cobra").plant
    assert isinstance(twin, Twin)
    loads = twin.advance(np.array([-0.004] * 12 + [0.0, 0.3]), 0.1)
    return float(loads[twin.description.tendon_names.index(name)])


@pytest.mark.parametrize("fault", ["break", "loosen"])
def test_a_tendon_that_breaks_or_comes_off_its_spool_carries_nothing(desk: FaultDesk, fault: str) -> None:
    assert tension("E1") > 2.0
    assert "E1" in desk.make(f"{fault} E1")
    assert tension("E1") == pytest.approx(0.0, abs=0.1)
    assert tension("N1") > 2.0


def test_a_tendon_that_is_stuck_needs_a_twin_with_friction(desk: FaultDesk) -> None:
    if world_of("cobra").plant._cables is None:
        with pytest.raises(FaultError, match=r"E1 cannot jam.*--losses nominal"):
            desk.make("snag E1")
    else:
        assert desk.make("snag E1") == "the tendon of E1 is stuck in its conduit"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("explode", "'explode' is no fault; there are drop, "),
        ("break", "say which drive; there are all, S1"),
        ("break S9", "no drive 'S9'"),
        ("break feed", "drive 'feed' pulls no tendon"),
        ("loosen E1 much", "'much': must be a number from 0 to 1000"),
        ("drop E1 2", "'2': must be a number from 0 to 1"),
        ("bus-off second", "no bus 'second'; there are main"),
        ("mute-cell E1", "load cells have none"),
    ],
)
def test_what_cannot_be_is_one_line_that_says_what_can(desk: FaultDesk, line: str, words: str) -> None:
    with pytest.raises(FaultError, match=words) as told:
        desk.make(line)
    assert "\n" not in str(told.value)


def test_help_names_every_fault() -> None:
    assert all(name in FaultDesk.usage() for name in FAULTS)
