"""How fast the twin runs, as a multiple of real time on one core (processor time), with all drives moving."""

import time

import mujoco
import numpy as np
import pytest

from cobra.loading import load_description
from cobra.simulation.environments import environment
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


@pytest.mark.parametrize("world", ["bent-pipe", "straight-pipe", "engine-stage"])
def test_the_twin_in_contact_against_real_time(world: str) -> None:
    """Bent against the walls and fed through them, losses on."""
    description = with_losses(load_description("cobra"), "seeded", 1)
    twin = build_twin(description, environment=environment(world, description))
    start = _driven(twin, 0.0)
    twin.advance(start, 0.0)
    twin.advance(start, 0.5)
    times, touching, deepest = [], [], 0.0
    for block in range(160):
        travel = [_driven(twin, (block * 50 + i) * CHUNK_S) for i in range(50)]
        began = time.thread_time()
        for target in travel:
            twin.advance(target, CHUNK_S)
        times.append((time.thread_time() - began) / len(travel))
        touching.append(len(twin.truth().contact_points))
        deepest = min(deepest, float(twin.data.contact.dist.min(initial=0.0)))
    print(
        f"\n{world}: {CHUNK_S / float(np.mean(times)):.1f} x real time mean, {CHUNK_S / max(times):.1f} x in the slowest "
        f"0.1 s; {np.mean(touching):.0f} contacts on average, {max(touching)} at most, {-1e3 * deepest:.2f} mm deep at most"
    )
    assert twin.recoveries == 0
    assert max(touching) > 0


def _driven(twin: Twin, time_s: float) -> np.ndarray:
    """Bends of up to 70 degrees in all sections and half the active length fed, as fast as COBRA may (30 deg/s, 30 mm/s)."""
    d = twin.description
    travel = np.zeros(len(d.drives))
    azimuths = np.concatenate([np.radians(s.routing.azimuths_deg) for s in d.sections if s.routing])
    bend = 1.2 * np.sin(2 * np.pi * time_s / 14.4)
    sections = np.array(d.tendon_section) + 1
    wound = 0.0033 * bend * sections * np.cos(azimuths - 0.3 * time_s)
    travel[list(d.tendon_drives)] = -wound - 8.0 / twin.chain.tendon_stiffness
    travel[d.feed_drive] = 0.375 - 0.075 * np.cos(2 * np.pi * time_s / 16)
    return travel


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
