"""Claims about load cells as the source of tension in a whole run: compensation and tension are led by the cells."""

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.description import LoadCell
from cobra.loading import load_description
from cobra.messages import Intent
from cobra.motors.cell_readings import CellCalibration
from cobra.simulation.drives import world_of
from tests.bench import CHANNEL, Bench

COBRA = load_description("cobra")
CELLS = tuple(
    LoadCell(tendon=name, bus="main", frame_id=0x300 + i, scale_N=0.01, rate_Hz=100.0, noise_N=0.05, bias_N=0.5)
    for i, name in enumerate(COBRA.tendon_names)
)

MOVING_M_S = 2e-4
"""A drive's current tells which way its gear rubs only while it moves."""


def tared() -> dict[str, CellCalibration]:
    """As taring finds them: what each simulated cell reads without a tension."""
    nodes = world_of(CHANNEL).amplifiers.values()
    return {
        cell.tendon: CellCalibration(offset_N=bias)
        for node in nodes
        for cell, bias in zip(node.cells, node.bias_N, strict=True)
    }


def rms(errors: list[np.ndarray]) -> float:
    return float(np.sqrt(np.mean(np.square(errors))))


@pytest.mark.long
def test_with_cells_the_tension_is_theirs_and_far_nearer_to_the_truth_than_from_currents():
    """The gears' friction is drawn within ±30 % of what the controller believes."""
    with Bench(seed=5, losses="seeded", description=replace(COBRA, load_cells=CELLS)) as bench:
        for _ in range(5):
            bench.tick()
        bench.loop.commissioning._cells.calibrate(tared())
        assert bench.home().phase == "ready"
        for _ in range(5):
            bench.tick()
        own = list(bench.description.tendon_drives)
        friction = bench.loop.tendons.identified.losses.drive_friction_N
        from_cells, from_currents, off = [], [], []
        for direction in ((0.8, 0.6), (-0.8, -0.6), (0.3, -0.9)):
            for _ in range(100):
                state = bench.tick(Intent(primary=direction, section=1))
                truth = world_of(CHANNEL).truth()
                speed = np.array(state.drives.velocity)[own]
                from_cells.append(np.array(state.tendons.tension) - truth.tensions)
                currents = np.array(state.drives.load)[own] + friction * np.sign(speed)
                from_currents.append((currents - truth.tensions)[np.abs(speed) > MOVING_M_S])
                off.append(truth.bends.ravel() - np.array(state.commanded)[2:])
        cells, currents = rms(from_cells), rms([np.concatenate(from_currents)])
        print(
            f"\ntension off by {cells:.2f} N RMS from cells, {currents:.2f} N from currents; bends {np.degrees(rms(off)):.1f} deg"
        )
        assert cells < 0.3
        assert cells < 0.6 * currents
        assert not any(cell.trouble for cell in state.cells)
        # The tension loop goes by them too: nothing slack, nothing beyond its limit, and no healthy tendon blamed.
        tendon = bench.description.tendon
        assert truth.tensions.min() > tendon.min_tension_N
        assert truth.tensions.max() < tendon.max_tension_N
        assert state.tendons.warnings == ()


def test_cells_on_some_tendons_leave_the_pretension_even():
    """A cell tells a tendon's tension, a current the gear's friction too: homing must not compare the one with the other."""
    with Bench(seed=4, losses="seeded", description=replace(COBRA, load_cells=CELLS[:2])) as bench:
        for _ in range(5):
            bench.tick()
        bench.loop.commissioning._cells.calibrate({name: tared()[name] for name in ("S1", "E1")})
        assert bench.home().phase == "ready"
        assert not any(cell.trouble for cell in bench.tick().cells)
        tensions = world_of(CHANNEL).truth().tensions
        assert COBRA.tendon is not None
        assert tensions == pytest.approx(np.full(len(tensions), COBRA.tendon.pretension_N), abs=0.5)
