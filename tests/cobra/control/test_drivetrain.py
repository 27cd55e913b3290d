"""Claims about the way from configuration to motors: what a lost bus said last is kept, and is no news."""

import numpy as np
import pytest

from cobra.control.drivetrain import Drivetrain
from cobra.loading import load_description
from cobra.motors.bus import BusError
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
