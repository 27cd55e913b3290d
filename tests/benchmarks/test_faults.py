"""Faults of tendons at random moments of random driving: which are named, whose they are said to be, and after how long.

The twin's losses are drawn within ±30 % of the description; the controller sees frames only and knows the description, or
what a guided sweep would have told it (the twin's numbers, about as wrong). Every fault is a drive of its own.
`COBRA_FAULT_SEEDS` takes other seeds, as "1,2"; `COBRA_FAULT_DRIVES` another number of drives for each kind and seed.
"""

import os
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from cobra.messages import Intent
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL
from tests.benchmarks.test_tensions import random_sticks
from tests.swept import ready

SEEDS = [int(seed) for seed in os.environ.get("COBRA_FAULT_SEEDS", "1,2,3").split(",")]
DRIVES = int(os.environ.get("COBRA_FAULT_DRIVES", "8"))
HEALTHY_S = 4.0
"""At least so long is driven before the fault."""
WAIT_S = 20.0

Fault = tuple[tuple[str, ...], Callable[[Any, str], None]]
FAULTS: dict[str, Fault] = {
    "broken": (("broken", "slack"), lambda world, name: world.plant.break_tendon(name)),
    "slipped by 3 mm": (("slipped", "slack"), lambda world, name: world.plant.slip(name, 0.003)),
    "loose by 12 mm": (("slack", "slipped", "off its spool"), lambda world, name: world.plant.slip(name, 0.012)),
    "jammed": (("jammed",), lambda world, name: world.plant.jam(name)),
}
"""Words of which one must be said, and what is done to the twin."""


def drive(seed: int, number: int, fault: Fault, knows: str) -> tuple[str, float]:
    """What became of one fault, and the time until something was named [s]."""
    words, make = fault
    rng = np.random.default_rng([seed, number, 0xFA])
    with ready(seed, knows) as bench:
        name = bench.description.tendon_names[int(rng.integers(12))]
        dt_s = bench.loop.period_s
        begins, waits = round(rng.uniform(HEALTHY_S, HEALTHY_S + 3.0) / dt_s), round(WAIT_S / dt_s)
        for k, intent in enumerate(random_sticks(1000 * seed + number, begins + waits, dt_s)):
            if k == begins:
                make(world_of(CHANNEL), name)
            if bench.tick(intent).phase == "holding":
                bench.tick()  # let go, press again
            if faults := (*bench.loop.tendons.faults, *bench.states[-1].tendons.warnings):
                right = f"tendon {name} " in faults[0] and any(word in faults[0] for word in words)
                what = "blamed before there was any" if k < begins else "named" if right else "called something else"
                return what, (k - begins + 1) * dt_s
    return "not named", np.nan


def drive_along(seed: int, knows: str) -> float:
    """Time until any tendon, jammed while the sticks wind it in or pay it out at full speed, is named; NaN within 4 s not."""
    rng = np.random.default_rng([seed, 0xA1])
    with ready(seed, knows) as bench:
        section, hole = int(rng.integers(3)), int(rng.integers(4))
        routing = bench.description.sections[section].routing
        assert routing is not None
        name, azimuth = routing.names[hole], np.radians(routing.azimuths_deg[hole] + rng.choice([0.0, 180.0]))
        along = Intent(primary=(float(np.cos(azimuth)), float(np.sin(azimuth))), section=section, speed=1.0)
        for _ in range(50):
            bench.tick(along)
        world_of(CHANNEL).plant.jam(name)
        for k in range(400):
            bench.tick(along)
            if faults := bench.loop.tendons.faults:
                assert f"tendon {name} is jammed" in faults[0]
                return (k + 1) * bench.loop.period_s
    return np.nan


@pytest.mark.benchmark
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("knows", ["the description", "a sweep"])
def test_a_jam_is_named_at_full_speed_along_the_tendon(knows: str) -> None:
    times = np.sort([drive_along(seed, knows) for seed in range(1, 11)])
    print(
        f"\njammed, driven along at full speed, knowing {knows}: named after {np.round(times, 2)} s, median {np.median(times):.2f}"
    )
    if knows == "a sweep":
        assert np.isfinite(times).mean() >= 0.9


@pytest.mark.benchmark
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("knows", ["the description", "a sweep"])
@pytest.mark.parametrize("kind", FAULTS)
def test_faults_are_named(kind: str, knows: str) -> None:
    outcomes = [drive(seed, number, FAULTS[kind], knows) for seed in SEEDS for number in range(DRIVES)]
    count = Counter(outcome for outcome, _ in outcomes)
    times = np.sort([s for outcome, s in outcomes if outcome == "named"])
    print(
        f"\n{kind}, knowing {knows}, {len(outcomes)} drives: " + ", ".join(f"{what} {n}" for what, n in count.items())
    )
    if len(times):
        print(
            f"  after {np.median(times):.2f} s (median), {times[-1]:.2f} s at most; within 0.5 s: {np.mean(times <= 0.5):.0%}"
        )
    assert count["blamed before there was any"] == 0
    if kind != "jammed":  # which shows only where drives pull far enough against it
        assert count["named"] >= 0.9 * len(outcomes)
