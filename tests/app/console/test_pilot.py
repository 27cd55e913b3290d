"""Who drives, and what ends it."""

import math
import threading

import msgspec
import pytest

from app.console.inputs import Controls
from app.console.mapping import Selection
from app.console.pilot import ANSWER_S, ROBOT_SILENCE_S, SILENCE_S, Pilot
from cobra.clock import ManualClock
from cobra.loading import load_description
from cobra.messages import Intent

COBRA = load_description("cobra")
LB = frozenset({"left_shoulder"})
REST = Controls()
HELD = Controls(buttons=LB)
BENDING = Controls(left=(1.0, 0.0), buttons=LB)
TICK_S = 0.01


class Hand:
    """A pad in a hand: what it holds is read again and again, with a fresh stamp unless it hangs."""

    def __init__(self, clock, name="Red Pad"):
        self.name = name
        self._clock = clock
        self.holds = REST
        self.hangs_since = None

    def read(self):
        stamp = self._clock.now() if self.hangs_since is None else self.hangs_since
        return msgspec.structs.replace(self.holds, stamp=stamp)


class Desk:
    """The pilot with one pad and a robot that follows: `driving` while it is told to, else `ready`."""

    def __init__(self, description=COBRA):
        self.clock = ManualClock()
        self.pilot = Pilot(description, self.clock)
        self.pad = Hand(self.clock)
        self.pages = {}
        self.robot = "ready"
        self.follows = True
        self.pilot.attach("pad", self.pad)
        self.tick()

    def tick(self, count=1):
        """Let that many periods of the command stream pass; returns what was sent last."""
        for _ in range(count):
            self.clock.advance(TICK_S)
            if self.robot is not None:
                self.pilot.robot_phase(self.robot)
            for page, controls in self.pages.items():
                self.page(page, controls)
            wanted = self.pilot.command(self.clock.now())
            if self.follows and self.robot in ("ready", "driving"):
                self.robot = "driving" if wanted.held else "ready"
        return wanted

    def page(self, name, controls):
        self.pilot.update(name, msgspec.structs.replace(controls, stamp=self.clock.now()))

    def holds(self, controls):
        """The hand does something; returns what is sent then."""
        self.pad.holds = controls
        return self.tick(3)

    def drive(self):
        self.holds(REST)
        self.holds(HELD)
        wanted = self.holds(BENDING)
        assert wanted.held
        assert wanted.source == "pad"
        assert wanted.intent.primary == (1.0, 0.0)

    def words(self, source="pad"):
        return self.pilot.status(self.clock.now()).words[source]

    @property
    def ended(self):
        return self.pilot.command(self.clock.now()).ended

    def drives_again_only_after_release_centre_press(self, keep=BENDING):
        """From whatever ended the drive while the hand kept holding `keep`."""
        assert not self.holds(HELD).held, "centred but never let go"
        assert not self.holds(keep).held
        assert not self.holds(Controls(left=keep.left)).held
        assert not self.holds(keep).held, "let go but not centred"
        assert not self.holds(HELD).held, "that press was void: let go again"
        assert not self.holds(REST).held
        assert self.holds(HELD).held
        return self.holds(BENDING).held


@pytest.fixture
def desk():
    return Desk()


def test_holding_lb_from_rest_drives_and_letting_go_stops_in_the_same_tick(desk):
    desk.drive()
    desk.pad.holds = Controls(left=(1.0, 0.0))
    wanted = desk.tick()
    assert not wanted.held
    assert wanted.intent == Intent(section=0, speed=0.5), "at rest when not held"
    assert wanted.source == ""


def test_a_pad_that_is_first_seen_with_lb_held_does_not_drive(desk):
    desk.pilot.detach("pad")
    desk.pad.holds = HELD
    desk.pilot.attach("pad", desk.pad)
    assert not desk.tick(5).held
    assert desk.words() == "let go of LB, then press again"
    assert desk.holds(REST).held is False
    assert desk.holds(HELD).held


def test_a_press_with_the_stick_deflected_does_not_drive_even_when_it_is_centred_later(desk):
    desk.holds(Controls(left=(0.0, -0.5)))
    assert desk.words() == "centre the sticks, then hold LB"
    assert not desk.holds(Controls(left=(0.0, -0.5), buttons=LB)).held
    assert desk.words() == "let go of LB, centre the sticks, then press again"
    assert not desk.holds(HELD).held
    desk.holds(REST)
    assert desk.words() == "hold LB to drive"
    assert desk.holds(HELD).held


@pytest.mark.parametrize("off", [{"right": (0.3, 0.0)}, {"left_trigger": 0.2}, {"right_trigger": 0.2}])
def test_every_stick_and_trigger_must_be_centred(desk, off):
    desk.holds(Controls(**off))
    assert not desk.holds(Controls(**off, buttons=LB)).held


def test_a_pad_that_is_pulled_out_ends_the_drive(desk):
    desk.drive()
    desk.pad.holds = Controls(connected=False)
    assert not desk.tick().held
    assert desk.ended == "Red Pad is not connected"
    assert desk.words() == "Red Pad is not connected"
    assert desk.drives_again_only_after_release_centre_press()


def test_a_re_plug_between_two_ticks_ends_the_drive_when_the_pad_reports_it(desk):
    desk.drive()
    desk.page("pad", Controls(connected=False))  # pushed from the pad's own thread
    assert desk.pad.holds is BENDING
    assert not desk.tick().held
    assert desk.drives_again_only_after_release_centre_press()


def test_letting_go_needs_no_explanation_and_the_next_press_takes_the_last_one_away(desk):
    desk.drive()
    assert desk.holds(REST).ended == ""
    desk.drive()
    assert desk.holds(Controls(connected=False)).ended == "Red Pad is not connected"
    desk.drive()
    assert desk.tick().ended == ""


def test_a_pad_whose_thread_hangs_ends_the_drive_after_200_ms(desk):
    desk.drive()
    desk.pad.hangs_since = desk.clock.now()
    assert desk.tick(round(SILENCE_S / TICK_S) - 1).held
    wanted = desk.tick(3)
    assert not wanted.held
    assert desk.ended == wanted.ended == "Red Pad fell silent"
    desk.pad.hangs_since = None
    assert desk.drives_again_only_after_release_centre_press()


def test_a_gap_in_a_held_stream_ends_the_drive_even_when_nobody_looked_during_it(desk):
    desk.drive()
    desk.clock.advance(2 * SILENCE_S)
    desk.pilot.robot_phase("driving")
    desk.page("pad", BENDING)
    assert not desk.pilot.command(desk.clock.now()).held
    assert desk.ended == "Red Pad fell silent"


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 3.0])
def test_a_value_that_cannot_be_ends_the_drive_and_is_counted(desk, bad):
    desk.drive()
    desk.pad.holds = Controls(left=(1.0, bad), buttons=LB)
    wanted = desk.tick()
    assert not wanted.held
    assert wanted.intent.primary == (0.0, 0.0)
    counts = desk.pilot.status(desk.clock.now()).counts
    assert counts.get("pad: not a finite number", 0) + counts.get("pad: out of range", 0) >= 1
    assert desk.drives_again_only_after_release_centre_press()


def test_a_reading_stamped_in_the_future_or_with_no_time_does_not_drive(desk):
    for stamp in (desk.clock.now() + 60.0, math.nan):
        desk.drive()
        desk.pilot.update("pad", msgspec.structs.replace(BENDING, stamp=stamp))
        assert not desk.pilot.command(desk.clock.now()).held
        desk.tick(3)


def tremble(desk, seconds, size):
    """A hand that tries to hold the stick still in mid-travel."""
    for i in range(round(seconds / TICK_S)):
        desk.pad.holds = Controls(left=(0.6 + size * math.sin(i), 0.0), buttons=LB)
        wanted = desk.tick()
    return wanted


def test_a_stick_with_a_hands_tremor_drives_on_and_frozen_in_mid_travel_it_ends(desk):
    desk.drive()
    assert tremble(desk, 5.0, size=0.001).held
    assert desk.tick(150).held
    assert not desk.tick(100).held, "2 s without the tremor that it has shown to resolve"
    assert desk.ended == "Red Pad does not change any more, as if it were frozen"
    assert desk.drives_again_only_after_release_centre_press(keep=desk.pad.holds)


@pytest.mark.parametrize("travel", [0.6, 1.0])
def test_a_coarse_or_fully_pushed_stick_may_stay_constant_for_longer_but_not_for_ever(desk, travel):
    desk.drive()
    desk.pad.holds = Controls(left=(travel, 0.0), buttons=LB)
    assert desk.tick(1500).held
    assert not desk.tick(600).held


def test_a_button_shows_that_the_pad_is_alive(desk):
    desk.drive()
    desk.tick(1500)
    desk.pad.holds = Controls(left=(1.0, 0.0), buttons=LB | {"dpad_up"})
    assert desk.tick(1500).held


def test_resting_sticks_may_stay_still_while_the_dead_man_is_held(desk):
    desk.holds(REST)
    assert desk.holds(HELD).held
    assert desk.tick(6000).held


def test_stop_acts_from_anyone_at_any_time_and_once_per_press(desk):
    desk.drive()
    b = Controls(buttons=frozenset({"b"}))
    desk.page("page 1", b)
    assert not desk.pilot.command(desk.clock.now()).held
    assert desk.ended == "STOP by page 1"
    assert desk.pilot.take_actions() == ("stop",)
    desk.page("page 1", b)
    assert desk.pilot.take_actions() == ()
    assert not desk.tick(5).held


@pytest.mark.parametrize("spoilt", [{"connected": False}, {"left": (math.nan, 0.0)}])
def test_stop_acts_even_from_a_device_that_may_not_drive(desk, spoilt):
    desk.holds(Controls(buttons=frozenset({"b"}), **spoilt))
    assert desk.pilot.take_actions() == ("stop",)


def test_stop_on_the_driving_pad_ends_its_drive(desk):
    desk.drive()
    desk.pad.holds = Controls(left=(1.0, 0.0), buttons=LB | {"b"})
    assert not desk.tick().held
    assert desk.pilot.take_actions() == ("stop",)
    assert not desk.tick(5).held


def test_a_dead_man_that_goes_down_together_with_stop_is_no_press(desk):
    assert not desk.holds(Controls(buttons=LB | {"b"})).held
    assert not desk.holds(HELD).held


def test_a_stop_takes_back_an_arm_that_was_not_sent_yet(desk):
    desk.holds(Controls(buttons=frozenset({"start"})))
    desk.holds(Controls(buttons=frozenset({"b"})))
    assert desk.pilot.take_actions() == ("stop",)


def test_start_arms_with_sticks_centred_and_the_dead_man_let_go(desk):
    desk.robot = "disarmed"
    start = frozenset({"start"})
    for refused in (HELD, Controls(left=(0.5, 0.0)), Controls(connected=False)):
        desk.holds(refused)
        desk.holds(msgspec.structs.replace(refused, buttons=refused.buttons | start))
        assert desk.pilot.take_actions() == ()
    desk.holds(REST)
    desk.holds(Controls(buttons=start))
    assert desk.pilot.take_actions() == ("arm",)


def test_a_start_button_that_is_down_when_the_pad_comes_does_not_arm(desk):
    desk.pilot.detach("pad")
    desk.pad.holds = Controls(buttons=frozenset({"start"}))
    desk.pilot.attach("pad", desk.pad)
    desk.tick(3)
    assert desk.pilot.take_actions() == ()


@pytest.mark.parametrize("phase", ["disarmed", "homing", "holding", "stopped", "fault"])
def test_a_press_while_the_robot_is_not_ready_never_starts_a_drive_later(desk, phase):
    desk.robot = phase
    desk.holds(REST)
    assert not desk.holds(HELD).held
    desk.robot = "ready"
    assert not desk.tick(5).held
    desk.holds(REST)
    assert desk.holds(HELD).held


@pytest.mark.parametrize("phase", ["disarmed", "homing", "holding", "stopped", "fault", "ready"])
def test_a_robot_that_left_driving_by_itself_needs_release_centre_press(desk, phase):
    desk.drive()
    desk.robot = phase
    assert not desk.tick().held
    desk.robot = "ready"
    assert desk.drives_again_only_after_release_centre_press()


def test_a_robot_that_falls_silent_ends_the_drive(desk):
    desk.drive()
    desk.robot = None
    assert desk.tick(round(ROBOT_SILENCE_S / TICK_S) - 1).held
    assert not desk.tick(3).held
    assert desk.ended == "no word from the robot"
    desk.robot = "driving"  # it was only the line: what it reports first is the drive before
    assert not desk.tick(3).held


def test_a_robot_that_does_not_follow_may_not_start_to_move_later(desk):
    desk.follows = False
    desk.holds(REST)
    desk.holds(HELD)
    assert desk.holds(BENDING).held
    assert not desk.tick(round(ANSWER_S / TICK_S) + 1).held
    assert desk.ended == "the robot does not follow"


def test_a_quick_second_press_waits_for_the_robot_to_report_its_stop(desk):
    desk.drive()
    desk.follows = False  # its reports are on their way
    desk.pad.holds = REST
    desk.tick()
    assert desk.robot == "driving"
    assert not desk.holds(HELD).held
    desk.robot = "ready"
    assert desk.tick().held
    desk.robot = "driving"
    assert desk.tick(5).held


def test_a_waiting_press_is_void_when_the_stick_leaves_the_centre_or_the_wait_is_long(desk):
    for then in (lambda: desk.holds(BENDING), lambda: desk.tick(round(ANSWER_S / TICK_S) + 2)):
        desk.drive()
        desk.follows = False
        desk.pad.holds = REST
        desk.tick()
        desk.holds(HELD)
        then()
        desk.robot = "ready"
        assert not desk.holds(HELD).held
        desk.follows = True
        desk.tick()


def test_a_waiting_press_is_void_after_a_stop(desk):
    desk.drive()
    desk.follows = False
    desk.pad.holds = REST
    desk.tick()
    desk.holds(HELD)
    desk.page("page 1", Controls(buttons=frozenset({"b"})))
    desk.robot = "ready"
    assert not desk.tick(3).held


def test_a_second_source_never_takes_over_and_has_to_let_go_when_the_first_is_done(desk):
    desk.drive()
    desk.pages["page 1"] = REST
    desk.tick()
    desk.pages["page 1"] = HELD
    desk.tick(2)
    desk.pages["page 1"] = Controls(left=(0.0, 1.0), buttons=LB)
    wanted = desk.tick(5)
    assert (wanted.source, wanted.intent.primary) == ("pad", (1.0, 0.0))
    assert desk.words("page 1") == "Red Pad drives; only STOP acts from here"
    assert not desk.holds(REST).held, "the page was pressed before the pad let go"
    assert desk.words("page 1") == "let go of the hold button, centre the sticks, then press again"
    desk.pages["page 1"] = REST
    desk.tick()
    desk.pages["page 1"] = HELD
    assert desk.tick(2).source == "page 1"


def test_of_two_that_are_ready_the_first_to_press_drives(desk):
    desk.pages["page 1"] = REST
    desk.holds(REST)
    desk.pages["page 1"] = HELD
    assert desk.tick().source == "page 1"
    assert desk.holds(HELD).source == "page 1"


def test_a_page_that_falls_silent_ends_its_drive(desk):
    desk.pages["page 1"] = REST
    desk.tick()
    desk.pages["page 1"] = HELD
    assert desk.tick(3).source == "page 1"
    desk.pages.clear()
    assert desk.tick(round(SILENCE_S / TICK_S) - 1).held
    assert not desk.tick(3).held
    assert desk.ended == "page 1 fell silent"


def test_a_page_that_closes_ends_its_drive_at_once_and_another_page_starts_anew(desk):
    desk.pages["page 1"] = REST
    desk.tick()
    desk.pages["page 1"] = HELD
    desk.tick(3)
    desk.pages.clear()
    desk.pilot.detach("page 1")
    assert not desk.pilot.command(desk.clock.now()).held
    desk.pages["page 1"] = HELD
    assert not desk.tick(3).held


def test_a_device_put_in_the_place_of_the_driving_one_does_not_drive_on(desk):
    desk.drive()
    other = Hand(desk.clock, "Blue Pad")
    other.holds = BENDING
    desk.pilot.attach("pad", other)
    assert not desk.tick(3).held


def test_only_the_driver_chooses_section_and_speed_while_somebody_drives(desk):
    desk.drive()
    right = Controls(buttons=frozenset({"dpad_right", "dpad_up"}))
    desk.page("page 1", REST)
    desk.page("page 1", right)
    assert desk.pilot.status(desk.clock.now()).selection == Selection(0, 1)
    assert desk.pilot.select("page 1", section=2) == "pad drives"
    desk.pad.holds = Controls(left=(1.0, 0.0), buttons=LB | {"dpad_right", "dpad_up"})
    wanted = desk.tick(3)
    assert wanted.held
    assert (wanted.intent.section, wanted.intent.speed) == (1, 1.0)


def test_a_page_chooses_section_and_speed_by_index_and_is_told_what_is_allowed(desk):
    assert desk.pilot.select("page 1", section=2, level=0) == ""
    wanted = desk.tick()
    assert (wanted.intent.section, wanted.intent.speed) == (2, 0.25)
    assert "section 7 does not bend" in desk.pilot.select("page 1", section=7)
    assert "no speed level 3" in desk.pilot.select("page 1", level=3)
    assert desk.pilot.status(desk.clock.now()).selection == Selection(2, 0)


def test_the_command_carries_when_the_pad_was_read(desk):
    desk.drive()
    assert desk.pilot.command(desk.clock.now()).input_stamp == desk.clock.now()


def test_it_says_what_is_missing(desk):
    assert desk.words() == "hold LB to drive"
    desk.robot = "disarmed"
    desk.tick()
    assert desk.words() == "the robot is disarmed: arm it first"
    desk.robot = "stopped"
    desk.tick()
    assert desk.words() == "STOP is latched: clear it first"
    desk.robot = "ready"
    desk.holds(Controls(buttons=frozenset({"a"}), connected=False))
    assert desk.words() == "Red Pad has a button held since it came: let go of it"
    desk.holds(REST)
    desk.holds(HELD)
    assert desk.words() == "drives"


def test_many_threads_at_once_never_break_it(desk):
    done, failures = threading.Event(), []

    def page(name):
        try:
            for i in range(300):
                desk.page(name, HELD if i % 3 else REST)
                desk.pilot.status(desk.clock.now())
            desk.pilot.detach(name)
        except Exception as error:
            failures.append(error)

    def stream():
        while not done.is_set():
            desk.pilot.robot_phase("ready")
            desk.pilot.command(desk.clock.now())

    pages = [threading.Thread(target=page, args=(f"page {i}",)) for i in range(6)]
    streamer = threading.Thread(target=stream)
    for thread in (*pages, streamer):
        thread.start()
    for thread in pages:
        thread.join()
    done.set()
    streamer.join()
    assert failures == []
    assert desk.pilot.command(desk.clock.now()).source in ("", "pad")


def test_a_button_that_locks_acts_like_start_only_while_nobody_drives():
    desk = Desk(load_description("src-bot"))
    desk.holds(REST)
    desk.holds(HELD)
    desk.holds(msgspec.structs.replace(HELD, buttons=HELD.buttons | {"x"}))
    assert desk.pilot.take_actions() == ()
    desk.holds(REST)
    desk.holds(Controls(buttons=frozenset({"x"})))
    assert desk.pilot.take_actions() == ("lock",)


# ---------------------------------------------------------------------- modes, views, poses, clutch


def test_mode_view_and_pose_are_chosen_while_nobody_drives(desk):
    assert desk.pilot.choose("page 1", mode=1, frame=2, pose="inspect") == ""
    wanted = desk.tick()
    assert (wanted.selection.mode, wanted.intent.frame, wanted.intent.pose) == ("tip", "tip", "inspect")
    assert "no mode 9" in desk.pilot.choose("page 1", mode=9)
    assert "no view 3" in desk.pilot.choose("page 1", frame=3)
    desk.drive()
    assert "let go first" in desk.pilot.choose("page 1", mode=0)
    desk.pad.holds = Controls(left=(1.0, 0.0), buttons=LB | {"y", "back"})
    wanted = desk.tick(3)
    assert wanted.held
    assert (wanted.selection.mode, wanted.intent.frame) == ("tip", "tip")


def test_the_pad_steps_through_the_modes_when_it_lets_go(desk):
    desk.holds(Controls(buttons=frozenset({"y"})))
    assert desk.holds(REST).selection.mode == "tip"


def test_the_clutch_keeps_the_drive_and_takes_the_sticks_until_they_are_centred(desk):
    desk.drive()
    wanted = desk.holds(Controls(left=(1.0, 0.0), buttons=LB | {"a"}))
    assert wanted.held
    assert wanted.intent.primary == (0.0, 0.0)
    assert desk.holds(BENDING).intent.primary == (0.0, 0.0), "let go of, but not centred"
    assert desk.words() == "clutch: centre the sticks and let go of it"
    assert desk.holds(HELD).held
    assert desk.holds(BENDING).intent.primary == (1.0, 0.0)
