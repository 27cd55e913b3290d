"""Claims about the shape of a robot with chambers whose cables may hang slack."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from cobra.kinematics.tendons import TendonMap
from cobra.loading import load_description
from cobra.mechanics.slack_shape import SlackShape
from cobra.messages import Intent
from cobra.simulation.drives import world_of
from tests.bench import Bench

ROBOT = "src-bot"
SRC_BOT = load_description(ROBOT)
TENDONS = TendonMap(SRC_BOT)
SLACK = SlackShape(SRC_BOT, TENDONS)
BENDS, LENGTH = slice(2, 4), 4
SECTION = SRC_BOT.sections[0]
BENDING_Nm = SECTION.bending_stiffness_Nm2 / SECTION.length_m
AXIAL_N_m = SECTION.elongation.stiffness_N_m / SECTION.vertebrae


def q_of(x: float, y: float, length_m: float) -> np.ndarray:
    q = TENDONS.rest.copy()
    q[BENDS], q[LENGTH] = (x, y), length_m
    return q


def test_taut_cables_tell_the_shape_by_their_lengths_alone():
    q = q_of(0.4, -0.2, 0.215)
    assert SLACK.shape(TENDONS.lengths(q), TENDONS.rest) == pytest.approx(q, abs=1e-6)


@settings(max_examples=100)
@given(x=st.floats(-1.5, 1.5), y=st.floats(-1.5, 1.5), length_m=st.floats(0.202, 0.25))
def test_what_the_chambers_press_is_held_by_taut_cables_that_pull_and_by_the_guiders_stop(x, y, length_m):
    paid_out = TENDONS.lengths(q_of(x, y, length_m))
    found = SLACK.shape(paid_out, TENDONS.rest)[[2, 3, 4]]
    own = TENDONS.matrix[:, 2:5]
    hangs_m = paid_out - own @ (found - TENDONS.rest[2:5])
    assert hangs_m.min() > -1e-6, "no cable is longer than what is paid out"
    pressed = np.array([BENDING_Nm * found[0], BENDING_Nm * found[1], AXIAL_N_m * (found[2] - SECTION.length_m)])
    stop = SECTION.elongation.range_m[0]
    holding = [*own[hangs_m < 1e-6], *([[0.0, 0.0, -1.0]] if found[2] < stop + 1e-6 else [])]
    left = nnls(np.array(holding).T, -pressed)[1] if holding else np.linalg.norm(pressed)
    assert left < 1e-3


def test_cables_are_never_driven_slack_and_the_page_shows_the_twins_shape():
    """At its natural length SRC-Bot's chambers press on no cable: it shortens as it bends."""
    rng = np.random.default_rng(3)
    with Bench(seed=1, robot=ROBOT, losses="nominal") as bench:
        bench.home()
        for _ in range(5):
            bench.tick()
        errors = []
        for _ in range(6):
            x, y = map(float, rng.uniform(-1.0, 1.0, 2))
            for _ in range(200):
                bench.tick(Intent(primary=(x, y), length=0.8))
            for _ in range(30):
                state = bench.tick()
            q = np.array(state.commanded)
            assert SLACK.shape(TENDONS.lengths(q), q) == pytest.approx(q, abs=1e-6)
            for shape in (state.commanded, state.measured):
                errors.append(np.linalg.norm(world_of(ROBOT).truth().bends[0] - np.array(shape)[BENDS]))
    print(f"{np.degrees(max(errors)):.1f} degrees off the twin at most")
    assert max(errors) < np.radians(6.0)
