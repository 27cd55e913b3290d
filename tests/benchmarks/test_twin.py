"""How fast the twin runs, as a multiple of real time on one core (processor time), with all drives moving."""

import time

import mujoco
import numpy as np
import pytest

from cobra.loading import load_description
from cobra.simulation.losses import with_losses
from cobra.simulation.twin import Twin, build_twin

pytestmark = pytest.mark.benchmark

CHUNK_S = 0.002
"""How the simulated drives advance it."""


def winding(twin: Twin, time_s: float) -> np.ndarray:
    """All drives moving: bends of up to 60 degrees turning round, twist and feed to and fro."""
    d = twin.description
    travel = np.zeros(len(d.drives))
    azimuths = np.concatenate([np.radians(s.routing.azimuths_deg) for s in d.sections if s.routing])
    travel[list(d.tendon_drives)] = -0.0035 * np.cos(azimuths - 2 * time_s) - 8.0 / twin.chain.tendon_stiffness
    travel[d.twist_drive] = np.sin(time_s)
    travel[d.feed_drive] = 0.25 + 0.03 * np.cos(time_s)
    return travel


@pytest.mark.parametrize(("kind", "losses"), [("default", "seeded"), ("default", "off"), ("ideal", "off")])
def test_the_twin_against_real_time(kind: str, losses: str) -> None:
    twin = build_twin(with_losses(load_description("cobra"), losses, 1), kind)  # type: ignore[arg-type]
    twin.advance(winding(twin, 0.0), 0.5)
    times = []
    for block in range(40):
        travel = [winding(twin, (block * 50 + i) * CHUNK_S) for i in range(50)]
        start = time.thread_time()
        for target in travel:
            twin.advance(target, CHUNK_S)
        times.append((time.thread_time() - start) / len(travel))
    best, median = min(times), float(np.median(times))
    physics = _step_s(twin)
    print(
        f"\n{kind} twin, losses {losses}, {len(twin.description.drives)} drives, {twin.chain.model.nv} degrees of freedom: "
        f"{CHUNK_S / median:.1f} x real time median, {CHUNK_S / best:.1f} x best; "
        f"{1e6 * best:.0f} us for a step of {1e3 * CHUNK_S:.0f} ms, of which MuJoCo {1e6 * physics:.0f} us"
    )
    assert twin.recoveries == 0


def _step_s(twin: Twin) -> float:
    """The best time of MuJoCo's own step."""
    best = np.inf
    for _ in range(40):
        start = time.thread_time()
        for _ in range(50):
            mujoco.mj_step2(twin.chain.model, twin.data)
            mujoco.mj_step1(twin.chain.model, twin.data)
        best = min(best, (time.thread_time() - start) / 50)
    return float(best)
