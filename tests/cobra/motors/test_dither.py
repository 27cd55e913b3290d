"""Claims about pulling to and fro: it straightens a robot whose conduits rub unlike, and ends as it began."""

import numpy as np
import pytest
from msgspec.structs import replace

from cobra.kinematics.configuration import Configuration
from cobra.loading import description_text, load_description, parse_description
from cobra.mechanics.losses import described
from cobra.mechanics.rubbing import CONDUIT_NODES, Rubbing
from cobra.motors.commissioning.repeat import RepeatedHoming
from cobra.motors.dither import Dither
from cobra.motors.homing import Homing, HomingError

COBRA = load_description("cobra")
DT_S = 0.01


def unlike(seed: int) -> Rubbing:
    """COBRA, all drawn in to the same tension at the motors, through conduits that take up to 30 % more or less."""
    robot = Rubbing(replace(COBRA, tendon=replace(COBRA.tendon, dither_cycles=0)), described(COBRA).losses)
    spread = np.random.default_rng(seed).uniform(0.7, 1.3, (len(robot.slopes), 1))
    robot._capstan[:, :CONDUIT_NODES] = robot._capstan[:, :CONDUIT_NODES] ** spread
    robot.reset(np.full(len(robot.slopes), 2.0))
    for _ in range(300):
        move(robot, -0.5 * np.maximum(8.0 - robot.motor_N, 0.0) / robot.stiffness_N_m)
    return robot


def move(robot: Rubbing, paid_out_m: np.ndarray) -> None:
    robot.advance(paid_out_m, Configuration(COBRA).home(), np.zeros(len(robot.columns)), 1.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_conduits_that_rub_unlike_leave_less_bend(seed: int) -> None:
    robot = unlike(seed)
    before = np.degrees(np.abs(robot.bends).max())
    compliance = float(1.0 / robot.stiffness_N_m.mean())
    dither = Dither(0.4 * 8.0 * compliance, 5, compliance, robot.tendons.bending)
    strongest = 0.0
    while not dither.done:
        move(robot, dither.step(robot.motor_N, DT_S))
        strongest = max(strongest, float(robot.motor_N.max()))
    assert strongest < 2.0 * 8.0
    while robot.motor_N.mean() < 8.0:
        move(robot, np.full(len(robot.slopes), -2e-5))
    after = np.degrees(np.abs(robot.bends).max())
    print(f"conduits ±30 %: {before:.2f} degrees of bend before, {after:.2f} after")
    assert before > 1.0
    assert after < 0.75 * before


def test_it_begins_and_ends_with_paying_out_and_dies_away() -> None:
    dither = Dither(1e-3, 3, 0.0, np.zeros((4, 4)))
    at, ends, last = 0.0, [], 1.0
    for _ in range(10_000):
        if dither.done:
            break
        step = dither.step(np.full(4, 8.0), DT_S)
        assert step == pytest.approx(step[0])
        if step[0] * last < 0.0:
            ends.append(round(1e3 * at, 6))
        last, at = step[0] or last, at + step[0]
    assert ends == pytest.approx([1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -0.7, 0.5, -0.3])
    assert 1e3 * at == pytest.approx(0.3)


def homed(stiffness_N_m: float, stuck_N: float = 0.0) -> list[str]:
    """What homing did, on a robot of the test's own, whose tendon E2 carries more once they are pulled to and fro."""
    homing, travel, speed, did = Homing(COBRA, np.zeros((12, 12))), np.zeros(14), np.zeros(14), [""]
    while not homing.done:
        load = np.zeros(14)
        load[:12] = np.maximum(-travel[:12] - 0.002, 0.0) * stiffness_N_m
        load[5] += stuck_N * ("to and fro" in homing.progress)
        target = homing.step(travel, load, speed, DT_S)
        travel, speed = target, (target - travel) / DT_S
        did += [homing.progress] if homing.progress != did[-1] else []
    return did


def test_a_tendon_that_is_pulled_too_hard_on_the_way_ends_homing_and_is_named() -> None:
    assert any("to and fro" in what for what in homed(2000.0))
    with pytest.raises(HomingError, match=r"tendon E2 carries \d+ N while all are pulled to and fro, 16 N at most"):
        homed(2000.0, stuck_N=9.0)


def test_tendons_that_are_far_stiffer_than_described_are_not_pulled_to_and_fro() -> None:
    assert not any("to and fro" in what for what in homed(1e5))


def test_it_can_be_left_out_in_the_description() -> None:
    text = "dither_cycles = 0\n"

    without = parse_description(description_text("cobra").replace("[tendon]", "[tendon]\n" + text, 1), "mine")
    assert without.tendon is not None
    assert COBRA.tendon is not None
    assert (without.tendon.dither_cycles, COBRA.tendon.dither_cycles) == (0, 5)
    assert RepeatedHoming(without, np.zeros((12, 12)), 1).bounds.seconds > 30.0
