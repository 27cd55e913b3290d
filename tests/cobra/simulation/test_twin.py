"""The twin bends as the geometry says, pulls with real tension, and cannot push."""

import numpy as np
import pytest

from cobra.loading import load_description
from cobra.simulation.twin import Twin, build_twin

COBRA = load_description("cobra")


def taut(twin: Twin, tension_N: float = 6.0) -> np.ndarray:
    """Travel of a straight robot with every tendon at this tension."""
    d = twin.description
    travel = np.zeros(len(d.drives))
    travel[list(d.tendon_drives)] = -tension_N / twin.chain.tendon_stiffness
    if d.feed_drive is not None:
        travel[d.feed_drive] = d.active_length_m
    return travel


def test_a_straight_ideal_robot_holds_its_pretension_and_reaches_straight_ahead() -> None:
    twin = build_twin(COBRA, "ideal")
    travel = taut(twin)
    twin.advance(travel, 0.0)
    loads = twin.advance(travel, 0.2)
    np.testing.assert_allclose(loads[:12], 6.0, rtol=1e-6)
    np.testing.assert_allclose(twin.truth().tip_position, [0.0, 0.0, 0.3], atol=1e-9)


def test_a_tendon_paid_out_is_slack_and_has_exactly_no_tension() -> None:
    twin = build_twin(COBRA, "ideal")
    travel = taut(twin)
    travel[0] = 0.002
    loads = twin.advance(travel, 0.1)
    assert loads[0] == 0.0
    assert (loads[1:12] >= 0.0).all()


@pytest.mark.parametrize("travel", [np.zeros(3), np.full(14, np.nan)])
def test_travel_that_is_not_one_finite_number_a_drive_is_refused(travel: np.ndarray) -> None:
    with pytest.raises(ValueError, match="14 finite numbers"):
        build_twin(COBRA).advance(travel, 0.01)
