"""SRC-Bot in the real program on its twin: round a cone of directions, locked, refused, and freed again."""

import contextlib

import numpy as np
import pytest

from cobra.kinematics.backbone import Backbone
from cobra.loading import load_description
from cobra.messages import Push
from tests.stack import Page, Stack, running, wait_for

ROBOT = "src-bot"
BACKBONE = Backbone(load_description(ROBOT))
BENDS, LENGTH = slice(2, 4), 4
CONE_RAD = 0.6
DIRECTIONS = 3
QUICK = ("--frame-rate", "2")


def steer_to(page: Page, stack: Stack, bend, tolerance_rad=0.01) -> None:
    """Drive the bend vector to a place with the left stick, as a person who watches would, and let go."""
    observer = stack.observer

    def there() -> bool:
        """A machine that stalls ends the drive, as it must; then a person presses again."""
        page.hold()
        with contextlib.suppress(AssertionError):
            observer.wait("driving", lambda state: state.phase == "driving", 2.0)

        def near() -> bool:
            left = np.asarray(bend) - np.array(observer.state.commanded)[BENDS]
            size = float(np.hypot(*left))
            stick = left / max(size, 1e-9) * min(1.0, 0.35 + 2.0 * size)
            page.hold(left=[float(x) for x in stick])
            return size < tolerance_rad or observer.state.phase != "driving"

        wait_for("the bend", near)
        page.release()
        observer.wait("letting go", lambda state: state.phase != "driving")
        return float(np.hypot(*(np.asarray(bend) - np.array(observer.state.commanded)[BENDS]))) < 5 * tolerance_rad

    wait_for("the bend", there, 60.0)


def hold_until(page: Page, stack: Stack, status: str) -> None:
    def reached() -> bool:
        page.hold()
        with contextlib.suppress(AssertionError):
            stack.observer.wait(status, lambda state: state.lock.status == status, 8.0)
        page.release()
        stack.observer.wait("letting go", lambda state: state.phase == "ready")
        return stack.observer.state.lock.status == status

    wait_for(status, reached, 40.0)


def test_round_a_cone_of_directions_and_back_then_locked_and_freed(tmp_path):
    with running(tmp_path, "--twin", "ideal", *QUICK, robot=ROBOT) as stack, Page(stack.url) as page:
        page.arm()
        assert page.ask("speed", 2)["ok"]
        start = stack.observer.settled_tip()
        reach = float(np.linalg.norm(start))
        errors = []
        for angle in np.linspace(0.0, 2.0 * np.pi, DIRECTIONS + 1):
            steer_to(page, stack, CONE_RAD * np.array([np.cos(angle), np.sin(angle)]))
            tip = stack.observer.settled_tip()
            q = np.array(stack.observer.state.measured)
            errors.append(float(np.linalg.norm(tip - BACKBONE.tip(q)[:3, 3])))
            assert np.arctan2(tip[1], tip[0]) == pytest.approx(np.arctan2(q[3], q[2]), abs=0.05)
        assert "straighten" in page.ask("lock")["reasons"][0], "bent it is not locked"
        steer_to(page, stack, (0.0, 0.0), 0.004)
        back = float(np.linalg.norm(stack.observer.settled_tip() - start))
        print(
            f"ideal twin: round a cone of {np.degrees(CONE_RAD):.0f} degrees in {DIRECTIONS} directions the tip was "
            f"{1e3 * max(errors):.1f} mm ({max(errors) / reach:.1%} of reach) off the kinematics at most, "
            f"{1e3 * np.mean(errors):.1f} mm on average, and came back to {1e3 * back:.2f} mm ({back / reach:.2%})"
        )
        assert max(errors) < 0.02 * reach
        assert back < 0.01 * reach

        assert page.ask("lock")["ok"]
        wait_for("the page's word", lambda: page.snapshot["lock"]["status"] == "locking")
        hold_until(page, stack, "rigid")
        stack.observer.settled_tip()
        assert all(stack.observer.truth()["locked"]), "the twin's guiders have caught"
        page.hold()
        stack.observer.wait("driving", lambda state: state.phase == "driving")
        page.hold(left=[1, 0])
        wait_for("the refusal in words", lambda: "does not bend: unlock" in page.snapshot["lock"]["words"])
        assert np.hypot(*stack.observer.state.commanded[BENDS]) < 1e-6
        page.release()
        stack.observer.wait("letting go", lambda state: state.phase == "ready")
        assert page.ask("unlock")["ok"]
        hold_until(page, stack, "continuum")
        stack.observer.settled_tip()
        assert not any(stack.observer.truth()["locked"])
        assert page.snapshot["length_mm"] == pytest.approx(1e3 * stack.observer.state.measured[LENGTH], abs=0.5)


def test_on_its_equations_of_motion_it_drives_and_a_push_moves_the_twin_and_no_drive(tmp_path):
    with running(tmp_path, "--twin", "dynamics", *QUICK, robot=ROBOT) as stack, Page(stack.url) as page:
        page.arm()
        steer_to(page, stack, (0.4, 0.3))
        tip, q = stack.observer.settled_tip(), np.array(stack.observer.state.measured)
        assert np.linalg.norm(tip - BACKBONE.tip(q)[:3, 3]) < 0.03 * np.linalg.norm(tip)
        setpoints = stack.observer.state.drives.setpoint
        push = Push(vertebra=4, force_N=(0.0, 3.0, 0.0))

        def moved() -> bool:
            stack.observer.link.push(push)
            return bool(np.linalg.norm(stack.observer.tip() - tip) > 0.005)

        wait_for("the push to be felt", moved, 5.0)
        assert stack.observer.state.drives.setpoint == setpoints, "it moves the twin, and no drive is told"
        for nonsense in (Push(vertebra=99), Push(vertebra=0, force_N=(1e9, 0.0, 0.0))):
            stack.observer.link.push(nonsense)
        wait_for("it to end by itself", lambda: np.linalg.norm(stack.observer.tip() - tip) < 0.004, 10.0)
        assert stack.observer.state.phase == "ready"
