"""Claims about compensation across disarming and STOP: arming again jumps nothing, and what the tendons remember is kept."""

import numpy as np
import pytest

from cobra.messages import Intent, Request, Stop, encode
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench


def drive(bench: Bench, seconds: float, **intent) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick(Intent(**intent))


def rest(bench: Bench, seconds: float = 0.6) -> None:
    for _ in range(round(seconds / bench.loop.period_s)):
        bench.tick()


def off_deg(bench: Bench) -> np.ndarray:
    """Between the twin's bends and what is commanded (sections,)."""
    wrong = world_of(CHANNEL).truth().bends.ravel() - np.array(bench.states[-1].commanded)[2:]
    return np.degrees(np.linalg.norm(wrong.reshape(-1, 2), axis=1))


def disarmed_and_armed(bench: Bench) -> None:
    assert bench.ask(Request(what="disarm", lease=bench.lease)).ok
    rest(bench, 1.5)  # without torque the tendons pull their drives out, as far as the gears let them
    assert bench.states[-1].phase == "disarmed"


def stopped_and_cleared(bench: Bench) -> None:
    bench.loop.inbox.stop(encode(Stop(who="test", reason="somebody came near")))
    rest(bench, 0.1)
    assert bench.states[-1].phase == "stopped"
    reply = bench.ask(Request(what="acquire", who="test"))
    bench.lease, bench.epoch = reply.lease, reply.epoch
    rest(bench, 0.1)
    assert bench.ask(Request(what="clear", lease=bench.lease)).ok
    rest(bench, 0.5)


def test_arming_again_jumps_nothing_and_keeps_what_the_tendons_remember():
    with Bench(seed=3, losses="nominal") as bench:
        assert bench.home().phase == "ready"
        rest(bench, 0.05)
        own = list(bench.description.tendon_drives)
        for sign, interrupted in ((1.0, disarmed_and_armed), (-1.0, stopped_and_cleared)):
            # To and fro: the tendons then hold friction of both directions.
            drive(bench, 1.2, primary=(sign, 0.4), section=1)
            drive(bench, 0.3, primary=(-sign, -0.4), section=1)
            rest(bench)
            interrupted(bench)
            before, stood = world_of(CHANNEL).truth().bends, np.array(bench.states[-1].drives.travel)[own]
            if bench.states[-1].phase == "disarmed":
                assert bench.ask(Request(what="arm", lease=bench.lease)).ok
            steps = []
            for _ in range(40):
                steps.append(np.array(bench.tick().drives.setpoint)[own])
            assert bench.states[-1].phase in ("ready", "holding")
            # Where the drives stood, to a count of their encoders, and not moved since.
            assert np.abs(np.diff(steps, axis=0)).max() < 1e-6
            assert steps[0] == pytest.approx(stood, abs=2e-4)
            assert np.degrees(world_of(CHANNEL).truth().bends) == pytest.approx(np.degrees(before), abs=0.3)
            # Bends still arrive where they are sent.
            drive(bench, 1.0, primary=(-sign, -0.4), section=1)
            rest(bench)
            assert off_deg(bench).max() < 4.0
