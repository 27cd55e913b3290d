"""What a guided sweep would tell of a twin with seeded losses, without the minutes that it takes."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from cobra.mechanics.losses import Identified, Losses
from cobra.simulation.options import Simulation
from tests.bench import Bench

WITHIN = {
    "axial_stiffness_N": 0.015,
    "drive_friction_N": 0.02,
    "backlash_m": 0.06,
    "hole_friction": 0.05,
    "conduit_capstan": 0.02,
    "radius_m": 0.04,
    "bending_stiffness_Nm2": 0.07,
    "settling_s": 0.2,
}
"""Standard deviation of what a guided sweep finds, as share of the truth (README, "Measured")."""
IN_COMMON = ("radius_m",)
"""Wrong by the same share in all sections."""


def swept(seed: int, bench: Bench) -> Identified:
    """The twin's true numbers, as wrong as a sweep may be."""
    rng = np.random.default_rng([seed, 0x5E])
    true = Losses.described(Simulation(losses="seeded", seed=seed).true(bench.description))
    found: dict[str, Any] = {}
    sure: dict[str, Any] = {}
    for name, share in WITHIN.items():
        value = np.abs(getattr(true, name))
        found[name] = value * (1.0 + share * rng.standard_normal(() if name in IN_COMMON else np.shape(value)))
        sure[name] = share * value
    return Identified(Losses(**found), Losses(**sure), "a sweep")


@contextmanager
def ready(seed: int, knows: str, world: str = "free") -> Iterator[Bench]:
    """A homed robot on a twin with seeded losses, that knows "the description" or "a sweep", ready to be driven."""
    with Bench(seed=seed, losses="seeded", world=world) as bench:
        if knows == "a sweep":
            bench.loop.tendons.use(swept(seed, bench))
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        yield bench
