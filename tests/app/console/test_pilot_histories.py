"""Random histories of pads, pages and robot, judged by an oracle that knows only the rule and what was read.

The rule: the dead-man may move the robot only if the driving source's readings up to now end in an unbroken run of sound,
fresh ones with the dead-man held, the run began centred right after a sound reading with it let go, and since the run
began no drive has ended, nobody pressed STOP, and the robot was `ready` or `driving` without falling silent.
"""

import math
from dataclasses import dataclass, field

import msgspec
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

from app.console.inputs import Controls
from app.console.pilot import ROBOT_SILENCE_S, SILENCE_S, Pilot
from cobra.clock import ManualClock
from cobra.loading import load_description

COBRA = load_description("cobra")
LB = frozenset({"left_shoulder"})
REST, HELD = Controls(), Controls(buttons=LB)
BENDING = Controls(left=(0.8, 0.0), buttons=LB)
DEAD_ZONE = 0.12
TRIGGER_DEAD_ZONE = 0.05

controls = st.one_of(
    st.sampled_from([REST, HELD, BENDING]),
    st.sampled_from([REST, HELD, BENDING]),
    st.builds(
        Controls,
        left=st.sampled_from([(0.0, 0.0), (0.05, -0.05), (0.0, -0.7), (math.nan, 0.0), (0.0, 2.0)]),
        right=st.sampled_from([(0.0, 0.0), (0.9, 0.0), (0.0, math.inf)]),
        right_trigger=st.sampled_from([0.0, 0.03, 0.6]),
        buttons=st.sets(st.sampled_from(["left_shoulder", "right_shoulder", "b", "start", "dpad_up"])).map(frozenset),
        connected=st.sampled_from([True, True, True, False]),
    ),
)
pages = st.sampled_from(["page 1", "page 2"])


def sound(reading):
    values = (*reading.left, *reading.right, reading.left_trigger, reading.right_trigger)
    return reading.connected and all(math.isfinite(v) and abs(v) <= 1 for v in values)


def at_rest(reading):
    sticks = max(math.hypot(*reading.left), math.hypot(*reading.right))
    return sticks <= DEAD_ZONE and max(reading.left_trigger, reading.right_trigger) <= TRIGGER_DEAD_ZONE


def held(reading):
    return "left_shoulder" in reading.buttons


@dataclass
class Trace:
    """All readings of one source, each with the number of the event that brought it."""

    readings: list = field(default_factory=list)

    def start_of_run(self, now):
        """The event at which the present run began, or None when the rule forbids it to drive."""
        run = None
        later = now
        for event, reading in reversed(self.readings):
            if not sound(reading):
                return None
            if not held(reading):
                return run[0] if run and at_rest(run[1]) else None
            if abs(later - reading.stamp) > SILENCE_S:
                return None
            later, run = reading.stamp, (event, reading)
        return None


class Histories(RuleBasedStateMachine):
    @initialize(first=controls)
    def begin(self, first):
        self.clock = ManualClock()
        self.pilot = Pilot(COBRA, self.clock)
        self.event = 0
        self.void = 0
        self.was_driving = ""
        self.traces = {}
        self.name = "Pad"
        self.holds = first
        self.hung_at = None
        self.phase = None
        self.mute = False
        self.told_s = -math.inf
        self.told = None
        self.wanted = None
        self.pilot.attach("pad", self)
        self.note("pad", self.read())
        self.observe()

    def read(self):
        stamp = self.clock.now() if self.hung_at is None else self.hung_at
        return msgspec.structs.replace(self.holds, stamp=stamp)

    def note(self, source, reading):
        self.event += 1
        trace = self.traces.setdefault(source, Trace())
        before = trace.readings[-1][1].buttons if trace.readings else frozenset()
        trace.readings.append((self.event, reading))
        if "b" in reading.buttons and "b" not in before:
            self.void = self.event

    def observe(self):
        """One period of the command stream."""
        following = "driving" if self.wanted is not None and self.wanted.held else "ready"
        if not self.mute:
            self.told, self.told_s = self.phase or following, self.clock.now()
            self.pilot.robot_phase(self.told)
            if self.told not in ("ready", "driving"):
                self.void = self.event
        if self.clock.now() - self.told_s > ROBOT_SILENCE_S:
            self.void = self.event
        self.note("pad", self.read())
        self.wanted = self.pilot.command(self.clock.now())
        if self.was_driving and self.wanted.source != self.was_driving:
            self.void = self.event - 1 if self.wanted.held else self.event
        self.was_driving = self.wanted.source

    @rule(holds=controls)
    def hand_moves(self, holds):
        self.holds = holds
        self.observe()

    @rule(page=pages, reading=controls)
    def page_sends(self, page, reading):
        reading = msgspec.structs.replace(reading, stamp=self.clock.now())
        self.note(page, reading)
        self.pilot.update(page, reading)
        self.observe()

    @rule(page=pages)
    def page_closes(self, page):
        self.pilot.detach(page)
        self.traces.pop(page, None)
        self.observe()

    @rule(seconds=st.sampled_from([0.01, 0.02, 0.1, 0.19, 0.21, 0.6, 1.1]))
    def time_passes(self, seconds):
        self.clock.advance(seconds)
        self.observe()

    @rule()
    def pad_hangs_or_recovers(self):
        self.hung_at = self.clock.now() if self.hung_at is None else None
        self.observe()

    @rule(phase=st.sampled_from([None, None, "ready", "driving", "holding", "stopped", "disarmed", "fault"]))
    def robot_says(self, phase):
        self.phase = phase
        self.observe()

    @rule()
    def robot_is_mute_or_speaks(self):
        self.mute = not self.mute
        self.observe()

    @precondition(lambda self: self.wanted is not None)
    @rule()
    def after_release_centre_and_press_it_always_drives(self):
        for page in ("page 1", "page 2"):
            self.page_closes(page)
        self.hung_at, self.mute, self.phase = None, False, None
        for holds in (REST, REST, REST, HELD):
            self.clock.advance(0.01)
            self.hand_moves(holds)
        assert self.wanted.held
        assert self.wanted.source == "pad"

    @invariant()
    def whoever_drives_is_allowed_to(self):
        if self.wanted is None:
            return
        rates = (*self.wanted.intent.primary, *self.wanted.intent.secondary, self.wanted.intent.feed)
        assert all(abs(rate) <= 1 for rate in rates)
        if not self.wanted.held:
            assert self.wanted.source == ""
            assert not any(rates), "what is not held is at rest"
            return
        began = self.traces[self.wanted.source].start_of_run(self.clock.now())
        assert began is not None, "no fresh, sound, unbroken press from the centre"
        assert began > self.void, "something ended the drive since that press began"
        assert self.told in ("ready", "driving")
        assert self.clock.now() - self.told_s <= ROBOT_SILENCE_S


Histories.TestCase.settings = settings(max_examples=200, stateful_step_count=50, deadline=None)
TestHistories = Histories.TestCase
