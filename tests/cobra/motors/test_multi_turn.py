"""The angle over many turns from an encoder of one: whatever the drive does, within its speed, and when the encoder slips."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobra.motors.multi_turn import MultiTurn

COUNTS = 2.0**14
FULL_SPEED_DPS = np.degrees(72.0)
"""Of the motor's shaft of COBRA's small motors."""
PERIOD_S = 0.01


def reading(angle_deg: float) -> float:
    return float(np.floor(angle_deg / 360.0 * COUNTS) % COUNTS)


def follow(turns: MultiTurn, angles_deg: np.ndarray, delays_s: np.ndarray) -> list[float]:
    """Feed it one drive's true angles, a period each, heard with delays; the jumps that it saw."""
    jumps = []
    for k, (angle, delay) in enumerate(zip(angles_deg, delays_s, strict=True)):
        turns.advance(np.array([reading(angle)]), np.array([0.0]), np.array([1.0 + k * PERIOD_S + delay]))
        if k == 0:
            turns.anchor(0, angle)
        jumps.append(float(turns.jump_deg[0]))
    return jumps


@given(
    speeds=st.lists(st.floats(-1.0, 1.0), min_size=2, max_size=60),
    delays=st.lists(st.floats(0.0, 0.9 * PERIOD_S), min_size=61, max_size=61),
    start=st.floats(-1000.0, 1000.0),
)
def test_any_motion_within_its_speed_is_followed_and_no_jump(speeds, delays, start):
    """Also where replies come late and one right after the other."""
    angles = start + np.concatenate([[0.0], np.cumsum(np.array(speeds) * FULL_SPEED_DPS * PERIOD_S)])
    turns = MultiTurn(np.array([COUNTS]), np.array([FULL_SPEED_DPS]))
    assert not any(follow(turns, angles, np.array(delays[: len(angles)])))
    assert turns.angle_deg[0] == pytest.approx(angles[-1], abs=2 * 360.0 / COUNTS)


@pytest.mark.parametrize("slip_deg", [-135.0, 120.0, 160.0])
@pytest.mark.parametrize("speed", [-0.2, 0.0, 0.2])
def test_a_slip_is_seen_at_once_with_its_size(slip_deg, speed):
    angles = speed * FULL_SPEED_DPS * PERIOD_S * np.arange(20)
    angles[10:] += slip_deg
    turns = MultiTurn(np.array([COUNTS]), np.array([FULL_SPEED_DPS]))
    jumps = follow(turns, angles, np.zeros(20))
    assert [k for k, jump in enumerate(jumps) if jump] == [10]
    assert jumps[10] == pytest.approx(slip_deg + speed * FULL_SPEED_DPS * PERIOD_S, abs=0.1)
