"""The three ways in which COBRA is deployed, driven through the page in the real program on the ideal twin.

The twin's own tip, which no controller sees, is the witness.
"""

import numpy as np
import pytest

from cobra.kinematics.configuration import FEED, TWIST
from tests.stack import Page, running, wait_for

CALM = ("--twin", "ideal", "--frame-rate", "2")
SIDE_MM = 20.0
CORNERS = ((-1, 0, 0), (0, 1, 0))
NEAR_MM = 1.0
FAST = 2
"""Of the speed levels."""
REACH_M = 0.3


def steer(page: Page, target_mm: np.ndarray) -> bool:
    """Push the sticks, as seen from behind, towards a place of the tip; whether it is there."""
    if page.snapshot["phase"] != "driving":
        page.press()  # a machine that stalls ends the drive, as it must; a person presses again
    missing = target_mm - np.array(page.snapshot["tip_mm"])
    distance = float(np.linalg.norm(missing))
    if distance < NEAR_MM:
        return True
    x, y, z = missing / distance * min(1.0, 0.35 + distance / 20.0)
    page.hold(left=[x, y], rt=max(z, 0.0), lt=max(-z, 0.0))
    return False


def choose(page: Page, mode: str) -> None:
    page.release()
    page.until_phase("ready")
    names = [guide["name"] for guide in page.welcome["modes"]]
    assert page.ask("mode", names.index(mode))["ok"]


@pytest.mark.parametrize("robot", ["cobra", pytest.param("cobra-active", marks=pytest.mark.long)])
def test_the_tip_goes_round_a_triangle_in_tip_mode_and_comes_back(tmp_path, robot):
    with running(tmp_path, *CALM, robot=robot) as stack, Page(stack.url) as page:
        page.arm()
        assert page.ask("speed", FAST)["ok"]
        # Bent to and fro, so that the tip is inside its reach; straight, it is at the edge and cannot go back.
        page.press()
        page.hold(left=[1.0, 0.0], right=[-1.0, 0.0])
        stack.observer.wait("a bend", lambda state: state.commanded[2] > 0.9)
        choose(page, "tip")
        # First its rest: letting go is at once, coming to rest takes a quarter of a second.
        start = stack.observer.settled_tip()
        begin = np.array(page.snapshot["tip_mm"])
        corners = []
        for aside in (*CORNERS, (0, 0, 0)):
            aim = begin + SIDE_MM * np.array(aside, dtype=float)
            wait_for(f"the corner {aside}", lambda aim=aim: steer(page, aim), 40.0)
            page.release()
            page.until_phase("ready")
            corners.append(stack.observer.settled_tip() - start)
    print(
        f"{robot}: corners {np.round(np.array(corners) * 1e3, 1).tolist()} mm, closed to {1e3 * np.linalg.norm(corners[-1]):.1f} mm"
    )
    assert np.linalg.norm(corners[-1]) < 0.01 * REACH_M
    for corner, aside in zip(corners, CORNERS, strict=False):
        np.testing.assert_allclose(corner * 1e3, SIDE_MM * np.array(aside), atol=0.2 * SIDE_MM)


def test_the_borescope_goes_in_turns_and_comes_out(tmp_path):
    with running(tmp_path, *CALM, robot="cobra-twist-feed") as stack, Page(stack.url) as page:
        assert [guide["name"] for guide in page.welcome["modes"]] == ["section", "pose"]
        page.arm()
        assert page.ask("speed", FAST)["ok"]
        start = stack.observer.settled_tip()

        page.drive_until(lambda: stack.observer.state.commanded[FEED] > 0.35, rt=1)
        inside = stack.observer.settled_tip()
        assert inside[2] - start[2] > 0.045
        page.drive_until(lambda: stack.observer.state.commanded[TWIST] > 0.7, right=[1, 0], buttons=["right_shoulder"])
        turned = stack.observer.settled_tip()
        np.testing.assert_allclose(turned, inside, atol=2e-3)
        page.drive_until(lambda: stack.observer.state.commanded[FEED] < 0.302, lt=1)
        assert np.linalg.norm(stack.observer.settled_tip() - start) < 0.01 * REACH_M
