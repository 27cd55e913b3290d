"""Profiles: what they correct, that nothing needed gets lost in them, and that they are applied only while disarmed."""

import http.client
import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.console.front_door import FrontDoor
from app.console.inputs import Controls
from app.console.mapping import Profile
from app.console.pad_profile import BUTTONS, PadProfile, PadProfiles, ProfileError, corrected
from app.console.pad_routes import pad_routes
from app.console.pilot import Pilot, pace
from cobra.clock import ManualClock
from cobra.loading import load_description
from tests.page_fakes import FakeSession, cookie_of

COBRA = load_description("cobra")


def test_a_worn_stick_is_centred_and_reaches_its_end():
    worn = PadProfile(centre=(0.1, 0.0, 0.0, -0.2), reach=(0.8, 1.0, 1.0, 0.7))
    at_rest = corrected(Controls(left=(0.1, 0.0), right=(0.0, -0.2)), worn)
    assert (at_rest.left, at_rest.right) == ((0.0, 0.0), (0.0, 0.0))
    assert corrected(Controls(left=(0.9, 0.0), right=(0.0, 0.5)), worn).left[0] == pytest.approx(1.0)
    assert corrected(Controls(right=(0.0, 0.5)), worn).right[1] == pytest.approx(1.0)


def test_inverted_swapped_and_assigned():
    profile = PadProfile(invert=frozenset({"left_y"}), swap_sticks=True, assign={"a": "b", "b": "a"})
    seen = corrected(Controls(left=(0.2, 0.5), right=(0.1, 0.3), buttons=frozenset({"a"})), profile)
    assert (seen.left, seen.right) == ((0.1, 0.3), (0.2, -0.5))
    assert seen.buttons == {"b"}


@given(st.floats(-1, 1), st.floats(-0.5, 0.5), st.floats(0.3, 1.0))
def test_no_calibration_makes_a_reading_that_is_out_of_range(value, centre, reach):
    seen = corrected(Controls(left=(value, 0.0)), PadProfile(centre=(centre, 0, 0, 0), reach=(reach, 1, 1, 1)))
    assert -1.0 <= seen.left[0] <= 1.0


@given(st.permutations(BUTTONS))
def test_an_exchange_of_buttons_is_allowed(order):
    PadProfile(assign=dict(zip(BUTTONS, order, strict=True))).check()


@pytest.mark.parametrize("assign", [{"b": "a"}, {"left_shoulder": "x"}, {"a": "b", "b": "b"}])
def test_no_profile_takes_stop_or_the_dead_man_away(assign, tmp_path):
    profiles = PadProfiles(tmp_path / "pads.json")
    with pytest.raises(ProfileError, match="no button would do"):
        profiles.put("Pad", PadProfile(assign=assign))
    assert profiles.all() == {}


def test_profiles_are_kept_for_each_device(tmp_path):
    profiles = PadProfiles(tmp_path / "pads.json")
    profiles.put("Pad A", PadProfile(swap_sticks=True))
    again = PadProfiles(tmp_path / "pads.json")
    again.start()
    assert again.of("Pad A").swap_sticks
    assert not again.of("Pad B").swap_sticks
    (tmp_path / "pads.json").write_text("{")
    with pytest.raises(ProfileError, match=r"pads\.json"):
        again.start()


def drive(profile: PadProfile, **controls) -> Pilot:
    clock = ManualClock()
    pilot = Pilot(COBRA, clock, lambda device: profile if device == "Pad" else PadProfile())
    pilot.robot_phase("ready")
    for buttons, moved in (
        (frozenset(), {}),
        (frozenset({"left_shoulder"}), {}),
        (frozenset({"left_shoulder"}), controls),
    ):
        pilot.update("page 1", Controls(buttons=buttons, stamp=clock.now(), **{"device": "Pad", **moved}))
    return pilot, clock


def test_a_pads_own_dead_zone_shapes_its_motion():
    wide = PadProfile(shape=Profile(stick_dead_zone=0.5, expo=0.0))
    pilot, clock = drive(wide, left=(0.4, 0.0))
    assert pilot.command(clock.now()).intent.primary == (0.0, 0.0)
    pilot, clock = drive(wide, left=(0.75, 0.0))
    assert pilot.command(clock.now()).intent.primary[0] == pytest.approx(0.5)


def test_a_late_driver_is_slower():
    assert [pace(lag) for lag in (0.0, 0.1, 0.2)] == [1.0, 1.0, 1.0]
    assert pace(0.35) == pytest.approx(0.625)
    assert pace(0.5) == pace(3.0) == 0.25
    pilot, clock = drive(PadProfile(), left=(1.0, 0.0), lag_s=0.5)
    slow = pilot.command(clock.now())
    pilot, clock = drive(PadProfile(), left=(1.0, 0.0), lag_s=0.05)
    assert slow.held
    assert slow.intent.speed == pytest.approx(0.25 * pilot.command(clock.now()).intent.speed)


def test_a_page_that_is_not_admitted_can_stop_and_nothing_else():
    clock, admitted = ManualClock(), {"page 1"}
    pilot = Pilot(COBRA, clock, admits=admitted.__contains__)
    pilot.robot_phase("ready")
    held = frozenset({"left_shoulder"})
    for page in ("page 2", "page 1"):
        pilot.update(page, Controls(stamp=clock.now()))
        pilot.update(page, Controls(buttons=held, stamp=clock.now()))
        assert pilot.status(clock.now()).driver == ("" if page == "page 2" else "page 1")
    assert pilot.select("page 2", level=0) != ""
    admitted.clear()
    assert not pilot.command(clock.now()).held, "the controls went to somebody else: the drive ends at once"
    pilot.update("page 2", Controls(buttons=frozenset({"b"}), stamp=clock.now()))
    assert pilot.take_actions() == ("stop",)


# ---------------------------------------------------------------- over the front door


@pytest.mark.parametrize(("armed", "status"), [(False, 200), (True, 409)])
def test_a_profile_is_applied_only_while_the_robot_is_disarmed(tmp_path, no_viewer_port, armed, status):
    profiles = PadProfiles(tmp_path / "pads.json")
    with FrontDoor("127.0.0.1", 0, no_viewer_port, FakeSession(), more=pad_routes(profiles, lambda: armed)) as door:

        def post(body: str) -> int:
            connection = http.client.HTTPConnection("127.0.0.1", door.port, timeout=10)
            connection.request("POST", "/pads", body, {"cookie": cookie_of(door.port)})
            return connection.getresponse().status

        assert post(json.dumps({"device": "Pad", "profile": {"swap_sticks": True}})) == status
        assert profiles.of("Pad").swap_sticks != armed
        if not armed:
            for bad in ("{", "[]", '{"device":"","profile":{}}', '{"device":"x","profile":{"assign":{"b":"a"}}}'):
                assert post(bad) == 400
            assert post('{"device":"' + "x" * 9000) == 413
    assert len(profiles.all()) == (0 if armed else 1)
