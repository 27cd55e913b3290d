"""Claims about pushing the twin: what is taken, what is refused, that it ends, and that hardware never listens."""

import numpy as np
import pytest

from app.twin_pushes import LAPSE_S, TwinPushes
from cobra.clock import ManualClock
from cobra.loading import load_description
from cobra.messages import Push, encode
from cobra.simulation.chain_plant import ChainPlant
from cobra.simulation.twin import build_twin

SRC_BOT = load_description("src-bot")
HANGING = np.full(3, -0.03)


@pytest.fixture(params=["dynamics", "mujoco"])
def plant(request):
    plant = ChainPlant(SRC_BOT) if request.param == "dynamics" else build_twin(SRC_BOT, "default")
    plant.advance(np.zeros(3), 0.0)
    plant.advance(HANGING, 1.0)
    return plant


def test_a_push_moves_the_twin_and_ends_when_it_is_not_repeated(plant):
    clock = ManualClock()
    pushes = TwinPushes(plant, SRC_BOT, clock)
    before = plant.truth().vertebrae
    for _ in range(10):
        pushes.take(encode(Push(vertebra=4, force_N=(3.0, 0.0, 0.0))))
        plant.advance(HANGING, 0.1)
        clock.advance(0.1)
        pushes.expire()
    moved = plant.truth().vertebrae - before
    assert moved[4, 0] > 0.005
    clock.advance(LAPSE_S + 0.1)
    pushes.expire()
    plant.advance(HANGING, 3.0)
    assert plant.truth().vertebrae == pytest.approx(before, abs=1.5e-3)


def test_a_push_of_nothing_ends_it_at_once(plant):
    pushes = TwinPushes(plant, SRC_BOT, ManualClock())
    before = plant.truth().vertebrae
    pushes.take(encode(Push(vertebra=4, force_N=(3.0, 0.0, 0.0))))
    pushes.take(encode(Push(vertebra=4)))
    plant.advance(HANGING, 1.0)
    assert plant.truth().vertebrae == pytest.approx(before, abs=5e-4)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\xff\x00",
        encode(Push(vertebra=5, force_N=(1.0, 0.0, 0.0))),
        encode(Push(vertebra=-1, force_N=(1.0, 0.0, 0.0))),
        encode(Push(vertebra=0, force_N=(float("nan"), 0.0, 0.0))),
        encode(Push(vertebra=0, force_N=(10.1, 0.0, 0.0))),
    ],
)
def test_what_is_no_push_is_counted_and_pushes_nothing(data):
    plant = ChainPlant(SRC_BOT)
    pushes = TwinPushes(plant, SRC_BOT, ManualClock())
    pushes.take(data)
    assert sum(pushes.refused.values()) == 1
    assert not plant._pushes.any()
