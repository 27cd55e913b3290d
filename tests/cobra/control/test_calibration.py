"""Claims about the calibration in force: it is told when it changes, and says how feedback becomes travel and load."""

from dataclasses import replace

import numpy as np
import pytest

from cobra.mechanics.losses import described, to_text
from cobra.messages import Calibration, CellScale, Request, decode, encode
from cobra.motors.cell_readings import CellCalibration
from tests.bench import Bench


def test_homing_tells_where_the_zeros_are_and_nothing_else_does():
    with Bench(seed=3, twin="ideal") as bench:
        for _ in range(5):
            bench.tick()
        (before,) = bench.calibrations
        assert not before.homed
        assert {drive.zero_rad for drive in before.drives.values()} == {None}
        assert bench.home().phase == "ready"
        homed = bench.calibrations[-1]
        assert homed.homed
        told = len(bench.calibrations)
        for _ in range(50):
            bench.tick()
        assert len(bench.calibrations) == told
        # From the drives' raw angles and currents with these numbers alone come the travel and load of the state.
        feedback, drives = bench.loop.drivetrain.feedback, bench.states[-1].drives
        for i, calibration in enumerate(homed.drives.values()):
            travel = (feedback.angle[i] - calibration.zero_rad) * calibration.travel_per_rad
            assert travel == pytest.approx(bench.loop.setpoints.travel()[i], abs=1e-9)
            assert feedback.current[i] * calibration.load_per_A == pytest.approx(drives.load[i], abs=0.5)
        assert decode(encode(homed), Calibration) == homed
        assert list(homed.drives) == [drive.name for drive in bench.description.drives]


def test_identified_losses_are_told_once_they_count():
    with Bench(seed=3, twin="ideal") as bench:
        bench.home()
        assert bench.calibrations[-1].source == "the description"
        own = described(bench.description)
        found = replace(own, losses=replace(own.losses, hole_friction=0.123), source="sweep of Monday")
        assert bench.ask(Request(what="parameters", lease=bench.lease, name=to_text(found))).ok
        assert bench.calibrations[-1].source == "the description", "not before it is homed with them"
        assert bench.ask(Request(what="home", lease=bench.lease)).ok
        for _ in range(3000):
            if bench.tick().phase == "ready":
                break
        now = bench.calibrations[-1]
        assert (now.source, now.losses["hole_friction"]) == ("sweep of Monday", 0.123)
        assert np.shape(now.losses["backlash_m"]) == (12,)


def test_what_commissioning_keeps_is_told_with_its_version():
    with Bench(seed=3, twin="ideal") as bench:
        bench.tick()
        assert bench.calibrations[-1].version == 0
        bench.loop.commissioning._book.keep("known force on E1", cells={"E1": CellCalibration(offset_N=0.4, gain=1.05)})
        bench.tick()
        now = bench.calibrations[-1]
        assert (now.version, now.by) == (1, "known force on E1")
        assert now.date
        assert now.cells == {"E1": CellScale(gain=1.05, offset_N=0.4)}
