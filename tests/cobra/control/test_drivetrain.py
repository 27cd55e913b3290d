"""Claims about the way from configuration to motors: what a lost bus said last is kept, and is no news; what homing finds anew."""

import numpy as np
import pytest

from cobra.control.drivetrain import Drivetrain
from cobra.kinematics.configuration import FEED, TWIST, Configuration
from cobra.loading import load_description
from cobra.motors.bus import HOME_AGAIN, BusError
from tests.obedient_bus import ObedientBus

COBRA = load_description("cobra")


class Pulled(ObedientBus):
    """Its plug may be pulled."""

    pulled = False

    def exchange(self, angles):
        if self.pulled:
            raise BusError("the adapter of bus 'main' is gone: plug it in")
        return super().exchange(angles)

    def told(self):
        if self.pulled:
            raise BusError("the adapter of bus 'main' is gone: plug it in")
        return super().told()


@pytest.mark.parametrize("overlapped", [False, True])
def test_what_drives_said_before_their_bus_was_lost_is_kept_and_not_taken_for_news(overlapped):
    bus = Pulled(len(COBRA.drives))
    drivetrain = Drivetrain(COBRA, bus)

    def exchange(travel):
        if overlapped:
            drivetrain.send(travel)
            drivetrain.gather()
            drivetrain.hear()
        else:
            drivetrain.exchange(travel)

    travel = np.linspace(0.001, 0.002, len(COBRA.drives))
    exchange(travel)
    assert drivetrain.gone == ""
    assert drivetrain.feedback.valid.all()
    bus.pulled = True
    exchange(travel)
    assert "plug it in" in drivetrain.gone
    assert not drivetrain.feedback.valid.any()
    assert np.isinf(drivetrain.feedback.age).all()
    np.testing.assert_allclose(drivetrain.transmission.travel(drivetrain.feedback.angle), travel)
    bus.pulled = False
    exchange(travel)
    assert drivetrain.gone == ""
    assert drivetrain.feedback.valid.all()
    assert np.isfinite(drivetrain.feedback.age).all()


def test_twist_and_feed_stay_what_they_are_known_to_be_until_their_drive_loses_its_count():
    bus = ObedientBus(len(COBRA.drives))
    drivetrain = Drivetrain(COBRA, bus)
    home = Configuration(COBRA).home()
    drivetrain.exchange(None)
    # The first time there is nothing to keep.
    q, lost = drivetrain.refer_tendons(bus.angles, home)
    np.testing.assert_array_equal(q, home)
    assert lost == ()
    moved = home.copy()
    moved[[TWIST, FEED]] = 0.7, 0.12
    drivetrain.exchange(drivetrain.travel_of(moved) + 0.003 * np.isin(np.arange(len(bus.angles)), COBRA.tendon_drives))
    q, lost = drivetrain.refer_tendons(bus.angles, home)
    assert q == pytest.approx(moved)
    assert lost == ()
    np.testing.assert_allclose(drivetrain.transmission.travel(bus.angles), drivetrain.travel_of(moved), atol=1e-12)
    faults = [""] * len(COBRA.drives)
    faults[COBRA.feed_drive] = f"its angle jumped by +90.0 degrees: {HOME_AGAIN}"
    bus.faults = tuple(faults)
    drivetrain.exchange(None)
    bus.faults = ("",) * len(faults)
    drivetrain.exchange(None)
    q, (lost,) = drivetrain.refer_tendons(bus.angles, home)
    assert q[TWIST] == pytest.approx(0.7)
    assert q[FEED] == home[FEED]
    assert "drive feed lost its count" in lost
    assert "300 mm" in lost
    # Said once: from here it is known again.
    assert drivetrain.refer_tendons(bus.angles, home)[1] == ()
