"""The map from the pad to the driver's intent."""

import math

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from app.console.guides import guides, pad_map
from app.console.inputs import Controls
from app.console.mapping import (
    Profile,
    Selection,
    centred,
    expo,
    fault_of,
    first_selection,
    map_controls,
    rescale,
    shape_axis,
    shape_stick,
)
from cobra.loading import load_description

COBRA = load_description("cobra")
BORESCOPE = msgspec.structs.replace(
    COBRA, sections=tuple(msgspec.structs.replace(section, routing=None) for section in COBRA.sections)
)
SRC_BOT = load_description("src-bot")
HAND_FED = msgspec.structs.replace(COBRA, twist=None, feed=None, hand_fed=True)
LINEAR = Profile(stick_dead_zone=0.1, trigger_dead_zone=0.1, expo=0.0)
BASE = Selection(0, 1)
REST = Controls()

value = st.floats(-1, 1)
dead_zone = st.floats(0, 0.9)
amount = st.floats(0, 1)
point = st.tuples(value, value)
profile = st.builds(Profile, stick_dead_zone=dead_zone, trigger_dead_zone=dead_zone, expo=amount)


def intent_of(controls, profile=LINEAR, selection=BASE, description=COBRA):
    return map_controls(controls, REST, selection, profile, description).intent


@given(value, value, dead_zone, amount)
def test_a_shaped_axis_is_odd_monotone_and_stays_within_one(a, b, dead, e):
    low, high = sorted((a, b))
    assert shape_axis(low, dead, e) <= shape_axis(high, dead, e)
    assert shape_axis(-a, dead, e) == -shape_axis(a, dead, e)
    assert abs(shape_axis(a, dead, e)) <= 1.0


@given(value, st.floats(0, 1e-3), dead_zone, amount)
def test_a_shaped_axis_has_no_jump_anywhere(a, step, dead, e):
    # The slope is at most (1 + 2e)/(1 − dead): that of the cubic's end, stretched over what the dead zone leaves.
    b = min(1.0, a + step)
    assert abs(shape_axis(b, dead, e) - shape_axis(a, dead, e)) <= (1 + 2 * e) / (1 - dead) * (b - a) + 1e-12


@given(dead_zone, amount)
def test_full_travel_is_full_rate_and_the_edge_of_the_dead_zone_is_zero(dead, e):
    assert shape_axis(1.0, dead, e) == pytest.approx(1.0)
    assert shape_axis(dead, dead, e) == 0.0
    assert shape_axis(math.nextafter(dead, 1), dead, e) == pytest.approx(0.0, abs=1e-12)


def test_expo_is_linear_at_zero_and_cubic_at_one():
    assert expo(0.5, 0.0) == 0.5
    assert expo(0.5, 1.0) == 0.125
    assert rescale(0.55, 0.1) == pytest.approx(0.5)


@given(point, dead_zone, amount)
@example((1.0, 1.0), 0.0, 0.0)
def test_a_stick_keeps_its_direction_and_is_never_longer_than_one(stick, dead, e):
    x, y = shape_stick(stick, dead, e)
    assert math.hypot(x, y) <= 1.0 + 1e-12
    assert x * stick[1] == pytest.approx(y * stick[0], abs=1e-12)
    assert x * stick[0] >= 0
    assert y * stick[1] >= 0


@given(st.floats(0, 2 * math.pi), st.floats(0, 1), dead_zone, amount)
def test_a_stick_is_as_fast_in_every_direction(angle, distance, dead, e):
    x, y = shape_stick((distance * math.cos(angle), distance * math.sin(angle)), dead, e)
    assert math.hypot(x, y) == pytest.approx(shape_axis(distance, dead, e), abs=1e-9)


@given(point, st.floats(0, 2 * math.pi), st.floats(0, 1e-3), dead_zone, amount)
def test_a_stick_has_no_jump_anywhere(stick, angle, step, dead, e):
    near = (stick[0] + step * math.cos(angle), stick[1] + step * math.sin(angle))
    a, b = shape_stick(stick, dead, e), shape_stick(near, dead, e)
    # Along the radius the slope is the axis's; across it no steeper, since the curve is convex from the dead zone on.
    assert math.dist(a, b) <= (1 + 2 * e) / (1 - dead) * step + 1e-9


def test_the_left_stick_bends_the_chosen_section_and_the_right_one_the_tip():
    intent = intent_of(Controls(left=(0.55, 0.0), right=(0.0, 0.55)), selection=Selection(1, 0))
    assert intent.primary == pytest.approx((0.5, 0.0))
    assert intent.secondary == pytest.approx((0.0, 0.5))
    assert (intent.section, intent.speed) == (1, 0.25)


def test_stick_up_is_up_in_the_view():
    # SDL's y is down, and so is the view's (MODEL.md, axes): nothing may flip on the way.
    assert intent_of(Controls(left=(0.0, -1.0))).primary == pytest.approx((0.0, -1.0))


def test_the_right_trigger_feeds_in_and_the_left_one_out():
    assert intent_of(Controls(right_trigger=1.0)).feed == 1.0
    assert intent_of(Controls(left_trigger=1.0)).feed == -1.0
    assert intent_of(Controls(left_trigger=0.8, right_trigger=0.8)).feed == 0.0


def test_the_right_bumper_turns_the_right_stick_from_bending_to_twisting():
    intent = intent_of(Controls(right=(1.0, 0.5), buttons=frozenset({"right_shoulder"})))
    assert intent.twist == 1.0
    assert intent.secondary == (0.0, 0.0)
    assert intent_of(Controls(right=(1.0, 0.0))).twist == 0.0


def test_only_the_left_bumper_holds():
    assert map_controls(Controls(buttons=frozenset({"left_shoulder"})), REST, BASE, LINEAR, COBRA).held
    assert not map_controls(Controls(buttons=frozenset({"right_shoulder", "a"})), REST, BASE, LINEAR, COBRA).held


@pytest.mark.parametrize(
    ("button", "before", "after"),
    [
        ("dpad_right", Selection(0, 1), Selection(1, 1)),
        ("dpad_right", Selection(2, 1), Selection(2, 1)),
        ("dpad_left", Selection(1, 1), Selection(0, 1)),
        ("dpad_left", Selection(0, 1), Selection(0, 1)),
        ("dpad_up", Selection(0, 1), Selection(0, 2)),
        ("dpad_up", Selection(0, 2), Selection(0, 2)),
        ("dpad_down", Selection(0, 0), Selection(0, 0)),
    ],
)
def test_the_dpad_steps_through_sections_and_speeds_and_stops_at_their_ends(button, before, after):
    pressed = Controls(buttons=frozenset({button}))
    mapped = map_controls(pressed, REST, before, LINEAR, COBRA)
    assert mapped.selection == after
    assert mapped.intent.section == after.section
    assert map_controls(pressed, pressed, after, LINEAR, COBRA).selection == after, "held is not pressed again"


@pytest.mark.parametrize(
    ("chosen", "button", "then"),
    [
        ("", "dpad_right", "look"),
        ("", "dpad_left", "rest"),
        ("look", "dpad_right", "turn"),
        ("rest", "dpad_right", "rest"),
        ("look", "dpad_left", "look"),
        ("deleted since", "dpad_right", "look"),
    ],
)
def test_in_pose_mode_the_dpad_steps_through_the_saved_poses_and_leaves_the_section(chosen, button, then):
    pressed, before = Controls(buttons=frozenset({button})), Selection(1, 1, "pose", pose=chosen)
    assert map_controls(pressed, REST, before, LINEAR, COBRA, ("look", "turn", "rest")).selection == Selection(
        1, 1, "pose", pose=then
    )
    assert map_controls(pressed, REST, before, LINEAR, COBRA).selection == before, "where none is saved"
    assert map_controls(pressed, REST, Selection(1, 1), LINEAR, COBRA, ("look",)).selection.pose == ""


def test_passive_sections_are_passed_over():
    sections = (*COBRA.sections[:1], msgspec.structs.replace(COBRA.sections[1], routing=None), *COBRA.sections[2:])
    gap = msgspec.structs.replace(COBRA, sections=sections)
    pressed = Controls(buttons=frozenset({"dpad_right"}))
    assert map_controls(pressed, REST, first_selection(gap), LINEAR, gap).selection.section == 2


def test_stop_and_arm_act_once_when_they_go_down():
    both = Controls(buttons=frozenset({"b", "start"}))
    assert map_controls(both, REST, BASE, LINEAR, COBRA).actions == ("stop", "arm")
    assert map_controls(both, both, BASE, LINEAR, COBRA).actions == ()
    assert map_controls(REST, both, BASE, LINEAR, COBRA).actions == ()


def test_what_the_robot_does_not_have_is_not_asked_for():
    everything = Controls(left=(1, 0), right=(1, 0), right_trigger=1.0)
    twisting = Controls(right=(1, 0), buttons=frozenset({"right_shoulder"}))
    assert intent_of(everything, selection=first_selection(BORESCOPE), description=BORESCOPE).primary == (0, 0)
    assert intent_of(everything, selection=first_selection(BORESCOPE), description=BORESCOPE).secondary == (0, 0)
    assert intent_of(everything, description=HAND_FED).feed == 0
    assert intent_of(twisting, description=HAND_FED).twist == 0


def test_a_session_starts_at_the_base_at_medium_speed():
    assert first_selection(COBRA) == Selection(0, 1)


bad_value = st.sampled_from([math.nan, math.inf, -math.inf, 1.5, -2.0, 1e300])


@given(bad_value, st.sampled_from(["left", "right", "left_trigger", "right_trigger"]), st.integers(0, 1))
def test_a_value_that_cannot_be_releases_everything_but_the_stop(bad, field, place):
    spoilt = bad if "trigger" in field else tuple(bad if i == place else 0.5 for i in range(2))
    controls = Controls(**{field: spoilt}, buttons=frozenset({"left_shoulder", "b"}))
    mapped = map_controls(controls, REST, BASE, LINEAR, COBRA)
    assert fault_of(controls) in ("not a finite number", "out of range")
    assert not mapped.held
    assert mapped.intent.primary == mapped.intent.secondary == (0, 0)
    assert mapped.intent.feed == mapped.intent.twist == 0
    assert mapped.actions == ("stop",)


def test_a_pad_that_is_gone_holds_nothing():
    gone = Controls(left=(1, 0), buttons=frozenset({"left_shoulder"}), connected=False)
    mapped = map_controls(gone, REST, BASE, LINEAR, COBRA)
    assert not mapped.held
    assert mapped.intent.primary == (0, 0)


def test_a_stick_that_overshoots_by_rounding_is_full_and_no_fault():
    full = Controls(left=(-1.00003, 0.0), right_trigger=1.0005)
    assert fault_of(full) is None
    assert intent_of(full).primary == (-1.0, 0.0)
    assert intent_of(full).feed == 1.0


trigger = st.floats(0, 1)
sound = st.builds(Controls, left=point, right=point, left_trigger=trigger, right_trigger=trigger)


@given(sound, profile, st.booleans())
def test_whatever_a_sound_pad_reads_the_intent_is_within_one_and_centred_means_at_rest(controls, shape, shift):
    if shift:
        controls = msgspec.structs.replace(controls, buttons=frozenset({"right_shoulder"}))
    intent = intent_of(controls, shape)
    rates = (*intent.primary, *intent.secondary, intent.feed, intent.twist)
    assert fault_of(controls) is None
    assert all(abs(rate) <= 1.0 for rate in rates)
    if centred(controls, shape):
        assert not any(rates)


def test_the_printed_map_names_every_control_that_acts():
    printed = " ".join(control for control, _ in pad_map(COBRA))
    for control in (
        "A",
        "Y",
        "Back",
        "LB",
        "Left stick",
        "Right stick",
        "RB",
        "Left trigger",
        "Right trigger",
        "D-pad",
        "B",
        "Start",
    ):
        assert control in printed


def test_on_a_robot_that_is_not_fed_the_triggers_change_the_length():
    pulled = intent_of(Controls(right_trigger=1.0, left_trigger=0.28), description=SRC_BOT)
    assert pulled.length == pytest.approx(0.8)
    assert pulled.feed == 0.0


def test_on_a_robot_that_is_fed_too_the_shift_button_makes_the_difference():
    fed = msgspec.structs.replace(SRC_BOT, feed=COBRA.feed)
    shift = frozenset({"right_shoulder"})
    plain = intent_of(Controls(left_trigger=1.0), description=fed)
    shifted = intent_of(Controls(left_trigger=1.0, buttons=shift), description=fed)
    assert (plain.feed, plain.length) == (-1.0, 0.0)
    assert (shifted.feed, shifted.length) == (0.0, -1.0)


def test_each_robots_map_tells_of_what_it_has_and_of_nothing_else():
    src_bot, borescope = (" ".join(f"{c}: {does}" for c, does in pad_map(d)) for d in (SRC_BOT, BORESCOPE))
    assert "Right trigger: lengthen" in src_bot
    assert "feed" not in src_bot
    assert "twist" not in src_bot
    assert "twist" in borescope
    assert "Left stick" not in borescope


@pytest.mark.parametrize(("description", "asked"), [(SRC_BOT, ("lock",)), (COBRA, ())])
def test_only_a_robot_that_can_lock_has_a_button_for_it(description, asked):
    pressed = Controls(buttons=frozenset({"x"}))
    assert map_controls(pressed, REST, BASE, LINEAR, description).actions == asked


# ---------------------------------------------------------------------- modes


def in_mode(mode, controls, description=COBRA, **selection):
    chosen = msgspec.structs.replace(BASE, mode=mode, **selection)
    return map_controls(controls, REST, chosen, LINEAR, description).intent


FULL = Controls(left=(0.6, -0.8), right=(1.0, 0.0), right_trigger=1.0)


def test_in_tip_mode_the_left_stick_moves_the_right_one_rolls_and_the_triggers_advance():
    intent = in_mode("tip", FULL)
    assert intent.primary == pytest.approx((0.6, -0.8))
    assert (intent.twist, intent.feed, intent.secondary) == (1.0, 1.0, (0.0, 0.0))
    # A robot that is fed by hand advances by its sections; there is nothing to roll it with.
    by_hand = in_mode("tip", FULL, HAND_FED)
    assert (by_hand.twist, by_hand.feed) == (0.0, 1.0)


def test_in_tip_following_the_left_stick_steers_and_the_base_is_not_twisted():
    intent = in_mode("following", FULL)
    assert (intent.twist, intent.feed, intent.secondary) == (0.0, 1.0, (0.0, 0.0))
    assert in_mode("following", FULL, HAND_FED).feed == 0.0


@pytest.mark.parametrize("mode", ["straighten", "pose"])
def test_going_to_a_shape_the_sticks_do_nothing_and_the_pose_is_sent_held_or_not(mode):
    for controls in (FULL, REST, Controls(connected=False)):
        intent = in_mode(mode, controls, pose="inspect")
        assert not any((*intent.primary, *intent.secondary, intent.feed, intent.twist, intent.length))
        assert intent.pose == "inspect"


def test_the_clutch_takes_the_sticks_away_and_keeps_the_dead_man():
    clutched = msgspec.structs.replace(FULL, buttons=frozenset({"a", "left_shoulder"}))
    mapped = map_controls(clutched, REST, BASE, LINEAR, COBRA)
    assert mapped.held
    assert mapped.intent.primary == (0.0, 0.0)
    assert mapped.intent.feed == 0.0


def test_y_and_back_step_through_modes_and_views_and_around():
    chosen, seen = BASE, []
    for button in ("y", "y", "back", "y", "y", "back", "y", "back"):
        chosen = map_controls(Controls(buttons=frozenset({button})), REST, chosen, LINEAR, COBRA).selection
        seen.append(chosen.mode if button == "y" else chosen.frame)
    assert seen == ["tip", "following", "base", "straighten", "pose", "tip", "section", "world"]


def test_each_mode_has_a_guide_that_names_only_what_acts_in_it():
    assert [guide.name for guide in guides(COBRA)] == ["section", "tip", "following", "straighten", "pose"]
    assert [guide.name for guide in guides(SRC_BOT)] == ["section", "tip", "straighten", "pose"], "it is not fed"
    assert [guide.title for guide in guides(BORESCOPE)] == ["Twist and feed", "Saved pose"]
    for robot in (COBRA, HAND_FED, SRC_BOT, BORESCOPE):
        for guide in guides(robot):
            intent = in_mode(guide.name, FULL, robot, section=robot.active_sections[-1] if robot.active_sections else 0)
            told = " ".join(line.pad for line in guide.lines)
            assert any(intent.primary) == bool(guide.left) == ("Left stick" in told), (robot.name, guide.name)
            assert any((intent.feed, intent.length)) == bool(guide.feed), (robot.name, guide.name)
            assert guide.help.endswith(".")
            words = f"{guide.help} {' '.join(line.does for line in guide.lines)}"
            assert robot.twist or "twist" not in words, (robot.name, guide.name)
            assert robot.feed or robot.hand_fed or "feed" not in words.lower(), (robot.name, guide.name)
            assert len(robot.active_sections) > 1 or "all sections" not in words, (robot.name, guide.name)
            assert all(line.does for line in guide.lines)
