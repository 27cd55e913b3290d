"""What commissioning prints: load cells beside the currents of their motors."""

import numpy as np
from msgspec.structs import replace

from app.commission_tables import cell_table
from cobra.description import LoadCell
from cobra.loading import load_description
from cobra.mechanics.losses import Losses
from cobra.motors.bus import CellReadings, Feedback
from cobra.motors.commissioning.procedure import Seen
from cobra.motors.transmission import Transmission

COBRA = load_description("cobra")
CELL = LoadCell(tendon="E1", bus="main", frame_id=0x301, scale_N=0.01, rate_Hz=100.0)
FITTED = replace(COBRA, load_cells=(CELL, replace(CELL, tendon="W3", byte_offset=2)))


def seen_at(tension_N: float, cells: CellReadings) -> Seen:
    """All drives have just wound in, against this tension and their gears' friction."""
    n = len(COBRA.drives)
    rubs = Losses.described(COBRA).drive_friction_N[0]
    zero = np.zeros(n)
    feedback = Feedback(
        angle=zero, velocity=zero, current=(tension_N + rubs) / Transmission(COBRA).load_per_A, temperature=zero,
        voltage=zero, age=zero, valid=np.ones(n, dtype=bool), missed=np.zeros(n, dtype=np.int64), faults=("",) * n,
        cells=cells,
    )  # fmt: skip
    return Seen(travel=zero, speed=zero, load=zero, feedback=feedback)


def test_each_cell_stands_beside_its_current_and_a_dead_one_has_no_tension() -> None:
    names = COBRA.tendon_names
    fitted = np.isin(names, ["E1", "W3"])
    tension = np.where(np.array(names) == "E1", 8.5, np.nan)
    trouble = tuple("silent: check its cable" if name == "W3" else "" for name in names)
    cells = CellReadings(tension=tension, raw=tension, age=np.zeros(12), trouble=trouble, fitted=fitted)
    head, first, second = cell_table(FITTED, seen_at(8.0, cells))
    assert head.split() == ["tendon", "cell", "current", "apart", "cell's", "state"]
    assert first.split() == ["E1", "8.50", "N", "8.00", "N", "0.50", "N", "fine"]
    assert second.split()[:5] == ["W3", "-", "8.00", "N", "-"]
    assert second.endswith("silent: check its cable")


def test_without_cells_there_is_nothing_to_compare() -> None:
    no = np.full(12, np.nan)
    cells = CellReadings(tension=no, raw=no, age=no, trouble=("",) * 12, fitted=np.zeros(12, dtype=bool))
    assert list(cell_table(COBRA, seen_at(8.0, cells))) == []
