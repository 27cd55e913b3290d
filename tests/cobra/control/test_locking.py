"""Claims about the rigid and the continuum status: how it is reached, what it refuses, and that nothing jumps on the way."""

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cobra.control.locking import Locking
from cobra.kinematics.configuration import Configuration
from cobra.loading import load_description
from cobra.messages import Intent, Request
from cobra.simulation.drives import world_of
from tests.bench import Bench

ROBOT = "src-bot"
SRC_BOT = load_description(ROBOT)
DT = 0.01
BENDS, LENGTH = slice(2, 4), 4
HOME = Configuration(SRC_BOT).home()
FREE = 5 * (0.042 + 0.25 * 0.002)


class Walk:
    """Steps a `Locking` as the loop does: what it allows is taken, and the motors are exact."""

    def __init__(self, q=HOME):
        self.locking = Locking(SRC_BOT)
        self.q, self.velocity = np.array(q), np.zeros_like(HOME)
        self.locking.reset(self.q)

    def step(self, moving=True, bend=(0.0, 0.0), length=0.0):
        wanted = self.q.copy()
        wanted[BENDS] += np.multiply(bend, DT)
        wanted[LENGTH] += length * DT
        q = self.locking.restrain(self.q, self.velocity, wanted, moving, DT)
        self.velocity, self.q = (q - self.q) / DT, q
        self.locking.observe(q, q)
        return self.locking.status

    def until(self, status, **step):
        for _ in range(2000):
            if self.step(**step) == status:
                return
        raise AssertionError(f"it never was {status}, it is {self.locking.status} at {self.q}")


def test_it_is_locked_by_asking_and_holding_and_freed_the_same_way():
    walk = Walk()
    assert walk.locking.status == "continuum"
    assert walk.locking.lock(walk.q, walk.q) == ()
    walk.until("rigid")
    assert walk.q[LENGTH] == pytest.approx(0.2)
    assert walk.locking.unlock() == ()
    walk.until("continuum")
    assert walk.q[LENGTH] >= 0.21, "longer than where the slots let go"


@pytest.mark.parametrize("which", ["commanded", "measured"])
def test_locking_is_refused_in_words_while_it_is_bent(which):
    walk, bent = Walk(), HOME.copy()
    bent[BENDS] = 0.3, -0.2
    reasons = walk.locking.lock(*((bent, HOME) if which == "commanded" else (HOME, bent)))
    assert "bent by 21 degrees" in reasons[0]
    assert "straighten" in reasons[0]
    assert walk.locking.status == "continuum"


def test_bending_is_refused_in_words_while_it_is_rigid_and_on_the_way():
    walk = Walk()
    walk.locking.lock(walk.q, walk.q)
    for status, word in (("locking", "being locked"), ("rigid", "rigid"), ("unlocking", "not free yet")):
        if status != "locking":
            walk.until("rigid")
        if status == "unlocking":
            walk.locking.unlock()
        walk.step(bend=(0.5, 0.0))
        assert walk.q[BENDS] == pytest.approx((0.0, 0.0))
        assert word in walk.locking.report().words
        walk.step()
        assert "does not bend: unlock" not in walk.locking.report().words, "a refusal ends with what was refused"


def test_it_stands_still_on_the_way_when_let_go():
    walk = Walk()
    walk.locking.lock(walk.q, walk.q)
    for _ in range(60):
        walk.step()
    for _ in range(40):
        walk.step(moving=False)
    before = walk.q.copy()
    walk.step(moving=False)
    assert walk.q == pytest.approx(before)
    assert walk.locking.status == "locking"
    assert walk.locking.unlock() == ()
    walk.until("continuum")


def test_free_it_cannot_be_shortened_to_where_its_guiders_would_catch():
    walk = Walk()
    for _ in range(500):
        walk.step(length=-0.01)
    assert walk.q[LENGTH] == pytest.approx(FREE)
    assert walk.locking.status == "continuum"
    assert "lock" in walk.locking.report().words


@pytest.mark.parametrize(("length", "status"), [(0.2, "rigid"), (0.206, "unlocking"), (0.22, "continuum")])
def test_switched_on_it_takes_the_status_of_the_length_it_has(length, status):
    q = HOME.copy()
    q[LENGTH] = length
    assert Walk(q).locking.status == status


def test_a_robot_that_cannot_lock_says_so_and_is_never_held_back():
    cobra = load_description("cobra")
    locking = Locking(cobra)
    rest = Configuration(cobra).rest()
    wanted = rest + 0.01
    assert locking.restrain(rest, rest * 0.0, wanted, True, DT) is wanted
    assert locking.lock(rest, rest) == locking.unlock() == ("this robot has nothing that locks",)
    assert locking.report().status == "none"


acts = st.lists(
    st.tuples(
        st.sampled_from(["lock", "unlock", "drive"]),
        st.booleans(),
        st.floats(-1, 1),
        st.floats(-1, 1),
        st.integers(1, 80),
    ),
    max_size=12,
)


@settings(max_examples=60)
@given(acts)
def test_whatever_is_asked_it_never_jumps_and_never_bends_while_its_guiders_may_touch(history):
    walk = Walk()
    rate = Configuration(SRC_BOT).rate[LENGTH]
    for what, moving, bend, length, steps in history:
        if what == "lock":
            walk.locking.lock(walk.q, walk.q)
        elif what == "unlock":
            walk.locking.unlock()
        for _ in range(steps):
            before, status = walk.q, walk.locking.status
            walk.step(moving, (bend if moving else 0.0, 0.0), length * rate if moving else 0.0)
            assert abs(walk.q[LENGTH] - before[LENGTH]) <= rate * DT + 1e-12
            assert np.hypot(*(walk.q - before)[BENDS]) <= 1.0 * DT + 1e-12
            assert walk.q[LENGTH] >= 0.2 - 1e-9
            if status != "continuum":
                assert np.hypot(*walk.q[BENDS]) <= np.hypot(*before[BENDS]) + 1e-12
            if walk.q[LENGTH] < FREE - 1e-6:
                assert walk.locking.status != "continuum"
                assert walk.q[BENDS] == pytest.approx((0.0, 0.0), abs=1e-9)


def hold(bench, seconds, **intent):
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))
    return bench.states[-1]


def let_go(bench, seconds=0.5):
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick()
    return bench.states[-1]


def test_homed_against_its_stop_it_stands_straight():
    with Bench(0, "ideal", ROBOT) as bench:
        bench.home()
        let_go(bench, 1.0)
        assert np.linalg.norm(world_of(ROBOT).truth().bends, axis=1) == pytest.approx(0.0, abs=np.radians(0.5))


def test_in_the_loop_on_its_twin_the_guiders_really_catch_and_let_go():
    with Bench(0, "default", ROBOT) as bench:
        bench.home()
        let_go(bench, 0.1)
        ask = lambda what: bench.ask(Request(what=what, lease=bench.lease))  # noqa: E731
        hold(bench, 0.8, primary=(1.0, 0.0))
        assert "straighten" in ask("lock").reasons[0] or "standing still" in ask("lock").reasons[0]
        let_go(bench)
        assert "straighten" in ask("lock").reasons[0]
        hold(bench, 1.5, primary=(-0.6, 0.0))
        while abs(bench.states[-1].commanded[2]) > 0.02:
            hold(bench, 0.02, primary=(-np.sign(bench.states[-1].commanded[2]) * 0.2, 0.0))
        let_go(bench)
        assert ask("lock").ok
        state = hold(bench, 4.0)
        assert state.lock.status == "rigid"
        let_go(bench, 1.0)
        assert all(world_of(ROBOT).truth().locked)
        state = hold(bench, 0.5, primary=(0.0, 1.0))
        assert "rigid" in state.lock.words
        assert state.commanded[BENDS] == pytest.approx((0.0, 0.0))
        let_go(bench)
        assert ask("unlock").ok
        assert hold(bench, 3.0).lock.status == "continuum"
        let_go(bench, 1.0)
        assert not any(world_of(ROBOT).truth().locked)
        hold(bench, 0.5, primary=(0.0, 1.0))
        assert msgspec.to_builtins(let_go(bench))["commanded"][3] > 0.1


def test_a_rigid_robot_that_is_abandoned_stays_rigid():
    with Bench(0, "default", ROBOT) as bench:
        bench.home()
        let_go(bench, 0.1)
        assert bench.ask(Request(what="lock", lease=bench.lease)).ok
        hold(bench, 4.0)
        assert let_go(bench).lock.status == "rigid"
        bench.loop.abandon(leave=True)
        for _ in range(300):
            bench.loop.tick()
            bench.clock.advance(bench.loop.period_s)
        assert bench.loop.quit_requested
        assert all(world_of(ROBOT).truth().locked)


def test_every_mode_that_the_robot_offers_is_held_back_while_it_is_rigid():
    with Bench(0, "ideal", ROBOT) as bench:
        bench.home()
        let_go(bench, 0.1)
        bench.ask(Request(what="lock", lease=bench.lease))
        hold(bench, 4.0)
        before = let_go(bench).commanded
        for mode in bench.states[-1].motion.modes:
            bench.mode = mode
            let_go(bench, 0.2)
            hold(bench, 0.4, primary=(0.7, 0.7), secondary=(0.5, 0.0), length=1.0, feed=0.5)
            assert let_go(bench).commanded == pytest.approx(before, abs=1e-9), mode
