"""Claims about how the pretension is shared among the tendons: a straight robot stays straight, however they lie."""

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from cobra.loading import load_description
from cobra.motors.pretension import LEAST_SHARE, pretension_shares

ACTIVE = load_description("cobra-active")


def shares(azimuths_deg):
    first = ACTIVE.sections[0]
    names = tuple(f"T{k}" for k in range(len(azimuths_deg)))
    routing = msgspec.structs.replace(first.routing, names=names, azimuths_deg=tuple(azimuths_deg))
    section = msgspec.structs.replace(first, routing=routing)
    return pretension_shares(msgspec.structs.replace(ACTIVE, sections=(section,)))


def moment(azimuths_deg, tensions):
    azimuths = np.radians(azimuths_deg)
    return np.array([tensions @ np.cos(azimuths), tensions @ np.sin(azimuths)])


@pytest.mark.parametrize("robot", ["cobra", "src-bot", "cobra-twist-feed"])
def test_even_azimuths_share_it_evenly(robot):
    description = load_description(robot)
    assert pretension_shares(description) == pytest.approx(np.ones(len(description.tendon_names)))


def test_uneven_azimuths_whose_equal_tensions_would_bend_it():
    azimuths = (10.0, 140.0, 250.0)
    assert np.linalg.norm(moment(azimuths, np.ones(3))) > 0.15
    assert moment(azimuths, shares(azimuths)) == pytest.approx(0.0, abs=1e-9)


@given(st.lists(st.floats(-40.0, 40.0), min_size=3, max_size=9))
def test_however_they_surround_the_backbone_they_pull_without_a_moment(offsets):
    azimuths = [360.0 * k / len(offsets) + offset for k, offset in enumerate(offsets)]
    around = np.sort(np.mod(azimuths, 360.0))
    assume(np.diff([*around, around[0] + 360.0]).max() < 150.0)
    found = shares(azimuths)
    assert moment(azimuths, found) == pytest.approx(0.0, abs=1e-7)
    assert found.mean() == pytest.approx(1.0)
    assert found.min() >= LEAST_SHARE - 1e-9
