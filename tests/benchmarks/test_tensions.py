"""Ten minutes of random driving: how long any tendon was slack or overloaded, by the twin's truth, and who was blamed.

The twin's losses are drawn within ±30 % of the description; the controller sees frames only and knows the description, or
what a guided sweep has told it.
Tensions count where they are measured, at the motors; what they are at the tendons' ends is printed beside them.
`COBRA_DRIVE_S` shortens the drive, `COBRA_DRIVE_SEEDS` takes other seeds, as "1,2".
"""

import os

import numpy as np
import pytest

from cobra.control.tension import SLACK_SHARE
from cobra.messages import Intent
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench
from tests.swept import ready

SECONDS = float(os.environ.get("COBRA_DRIVE_S", "600"))
SEEDS = [int(seed) for seed in os.environ.get("COBRA_DRIVE_SEEDS", "1").split(",")]
AT_MOST_S = 0.05
"""Slack or overloaded at a time."""
AT_MOST_OUTSIDE = 0.01
"""Of the time, of any tendon."""


def random_sticks(seed: int, ticks: int, dt_s: float) -> list[Intent | None]:
    """A driver who tries everything: bends of two sections at once, twist and feed, there and back, and lets go at times."""
    rng = np.random.default_rng([seed, 0xD81])

    def stick() -> tuple[float, float]:
        turn, far = rng.uniform(0.0, 2.0 * np.pi), min(1.0, rng.uniform(0.3, 1.3))
        return float(far * np.cos(turn)), float(far * np.sin(turn))

    def at_times(share: float) -> float:
        return float(np.clip(rng.uniform(-1.3, 1.3), -1.0, 1.0)) if rng.uniform() < share else 0.0

    out: list[Intent | None] = []
    while len(out) < ticks:
        count = int(rng.uniform(0.2, 3.0) / dt_s)
        if rng.uniform() < 0.15:
            out += [None if rng.uniform() < 0.5 else Intent()] * count
            continue
        (x, y), (u, v) = stick(), stick() if rng.uniform() < 0.4 else (0.0, 0.0)
        twist, feed, section = at_times(0.3), at_times(0.4), int(rng.integers(3))
        speed = float(rng.choice([0.25, 0.5, 1.0, 1.0]))
        rest = {"twist": twist, "feed": feed, "section": section, "speed": speed}
        out += [Intent(primary=(x, y), secondary=(u, v), **rest)] * count
        if rng.uniform() < 0.4:
            out += [Intent(primary=(-x, -y), secondary=(-u, -v), **rest)] * int(rng.uniform(0.2, 2.0) / dt_s)
    return out[:ticks]


def longest_s(bad: np.ndarray, dt_s: float) -> np.ndarray:
    """(m,) the longest time for which each column of (ticks, m) is true."""
    longest, now = np.zeros(bad.shape[1]), np.zeros(bad.shape[1])
    for row in bad:
        now = np.where(row, now + dt_s, 0.0)
        longest = np.maximum(longest, now)
    return longest


def drive(seed: int, world: str, knows: str) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """True tensions (ticks, m) at the motors, least along each tendon, and the faults named."""
    motors, least, named = [], [], []
    with ready(seed, knows, world) as bench:
        known = 0
        for k, intent in enumerate(random_sticks(seed, round(SECONDS / bench.loop.period_s), bench.loop.period_s)):
            state = bench.tick(intent)
            if state.phase == "holding":
                bench.tick()  # let go, press again
            faults = bench.loop.tendons.faults
            named += [f"{k * bench.loop.period_s:.1f} s: {fault}" for fault in faults[known:]]
            known = len(faults)
            truth = world_of(CHANNEL).truth()
            motors.append(truth.tensions)
            least.append(np.nanmin(truth.tension_profile, axis=1))
    return np.array(motors), np.array(least), named


@pytest.mark.benchmark
@pytest.mark.timeout(14_400)
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(
    ("world", "knows"), [(world, knows) for world in ("free", "bent-pipe") for knows in ("the description", "a sweep")]
)
def test_random_driving_keeps_every_tendon_in_its_limits_and_blames_none(world: str, knows: str, seed: int) -> None:
    motors, least, named = drive(seed, world, knows)
    with Bench(seed=seed) as bench:
        tendon, names, dt_s = bench.description.tendon, bench.description.tendon_names, bench.loop.period_s
    assert tendon is not None
    low, high = tendon.min_tension_N, tendon.max_tension_N
    print(f"\n{world}, knowing {knows}, seed {seed}, {SECONDS:.0f} s; limits {low:g} to {high:g} N")
    for place, tension in (("at the motor", motors), ("least on the way", least)):
        slack, over = longest_s(tension < SLACK_SHARE * low, dt_s), longest_s(tension > high, dt_s)
        outside = ((tension < low) | (tension > high)).mean(axis=0)
        worst = int(np.argmax(outside))
        print(
            f"  {place:>16}: {tension.min():.2f} to {tension.max():.1f} N; slack for {slack.max():.2f} s at most, overloaded "
            f"for {over.max():.2f} s; outside {outside.max():.2%} of the time ({names[worst]}), all {outside.mean():.2%}"
        )
        if tension is motors:
            for name, *numbers in zip(
                names, tension.min(axis=0), tension.max(axis=0), slack, over, outside, strict=True
            ):
                print(
                    "    {}: {:.2f} to {:.1f} N, slack {:.2f} s, over {:.2f} s, outside {:.2%}".format(name, *numbers)
                )
            kept = slack.max() <= AT_MOST_S and over.max() <= AT_MOST_S and outside.max() < AT_MOST_OUTSIDE
    print(f"  faults named, though there was none: {named or 'none'}")
    assert kept
    assert not named
