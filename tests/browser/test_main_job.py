"""The main job, end to end: a person in a browser arms COBRA and bends it; the twin's own tip is the witness."""

import contextlib

import numpy as np
import pytest

from cobra.kinematics.backbone import Backbone
from cobra.loading import load_description
from tests.stack import Stack, running, wait_for

WIDTH = 1280
COBRA = load_description("cobra")
CALM = ("--frame-rate", "5")
"""Chromium draws the scene in software here; fewer frames leave it time for the page."""


def arm(tab, stack: Stack) -> None:
    tab.get_by_test_id("arm").click()
    stack.observer.wait("ready", lambda state: state.phase == "ready", 60.0)


def push(tab, key: str, stack: Stack, until) -> None:
    """Hold the page's dead-man and a steering key; let go when `until` holds.

    A press in the moment of getting ready is void, and a machine that stalls for 200 ms ends the drive, as it must; a
    person then presses again.
    """

    def bent() -> bool:
        tab.keyboard.down("Space")
        with contextlib.suppress(AssertionError):
            stack.observer.wait("driving", lambda state: state.phase == "driving", 2.0)
        tab.keyboard.down(key)
        stack.observer.wait("the bend", lambda state: until(state) or state.phase != "driving", 60.0)
        tab.keyboard.up("Space")
        tab.keyboard.up(key)
        stack.observer.wait("letting go", lambda state: state.phase == "ready")
        return until(stack.observer.state)

    wait_for("the bend", bent, 120.0)


def bend(state, section: int) -> float:
    return float(np.hypot(*state.commanded[2 + 2 * section : 4 + 2 * section]))


def drive_and_compare(tab, stack: Stack) -> tuple[float, float, float]:
    """Bend two sections from the page; gives the arc of the tip, its error and the error of the encoders' estimate [m]."""
    arm(tab, stack)
    backbone = Backbone(COBRA)
    model, start = backbone.tip(np.array(stack.observer.state.measured))[:3, 3], stack.observer.settled_tip()
    push(tab, "d", stack, lambda state: bend(state, 0) > 0.5)
    push(tab, "ArrowUp", stack, lambda state: bend(state, 2) > 0.6)
    end, state = stack.observer.settled_tip(), stack.observer.state
    moved = backbone.tip(np.array(state.measured))[:3, 3] - model
    arc = float(np.linalg.norm(moved))
    q = np.array(state.measured)
    assert q[2] > 0.3, "stick right bends to the right"
    assert q[7] < -0.3, "stick up bends up, and y is down"
    estimate = float(np.linalg.norm(np.array(state.commanded) - q))
    assert estimate < 0.15, "the measured configuration comes from the motors and follows the commanded one"
    return arc, float(np.linalg.norm((end - start) - moved)), estimate


@pytest.mark.long
def test_the_ideal_twin_moves_to_where_the_kinematics_says(tab, tmp_path):
    with running(tmp_path, "--twin", "ideal", *CALM) as stack:
        tab.goto(stack.url)
        arc, error, _ = drive_and_compare(tab, stack)
    print(f"ideal twin: the tip moved {1e3 * arc:.1f} mm, {1e3 * error:.2f} mm ({error / arc:.1%}) off the kinematics")
    assert error < 0.05 * arc


def test_the_scene_is_drawn_and_the_twin_moves_as_driven_stops_when_let_go_and_by_stop(tab, tmp_path):
    errors = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    with running(tmp_path, *CALM) as stack:
        tab.goto(stack.url)
        the_scene_is_drawn(tab)
        arc, error, _ = drive_and_compare(tab, stack)
        print(
            f"default twin: the tip moved {1e3 * arc:.1f} mm, {1e3 * error:.1f} mm ({error / arc:.0%}) off the kinematics"
        )
        assert error < 0.2 * arc
        let_go_stops_within_two_ticks_and_the_ramp(tab, stack)
        stop_latches_until_it_is_cleared(tab, stack)
    assert errors == []


def let_go_stops_within_two_ticks_and_the_ramp(tab, stack):
    states = []
    stack.observer.link.on_state = states.append
    before = bend(stack.observer.state, 0)
    push(tab, "a", stack, lambda state: bend(state, 0) < before - 0.2)
    stack.observer.wait("rest", lambda state: state.commanded == states[-2].commanded)
    let_go = next(i for i in range(len(states) - 1, 0, -1) if states[i - 1].phase == "driving")
    ramp = COBRA.teleop.bend_rate_deg_s / COBRA.teleop.bend_acceleration_deg_s2 * COBRA.teleop.loop_rate_Hz
    moving = [i for i in range(1, len(states)) if states[i].commanded != states[i - 1].commanded]
    print(f"it stood {max(moving) - let_go + 1} ticks after letting go; the ramp is {ramp:.0f}")
    assert max(moving) - let_go + 1 <= 2 + ramp


def stop_latches_until_it_is_cleared(tab, stack):
    tab.get_by_test_id("stop").click()
    stopped = stack.observer.wait("stopped", lambda state: state.phase == "stopped")
    assert stopped.lease.holder == ""
    tab.get_by_test_id("state").filter(has_text="Stopped").wait_for()
    tab.get_by_test_id("clear").click()
    stack.observer.wait("ready", lambda state: state.phase == "ready")


def the_scene_is_drawn(tab):
    """And nothing lies over the robot: neither viser's notices, nor its panel where there is little room."""
    view = tab.frame_locator("#viewer")
    canvas = view.locator('canvas[data-engine^="three.js"]')
    canvas.wait_for()
    assert canvas.bounding_box()["width"] > WIDTH / 4
    assert canvas.evaluate("canvas => getComputedStyle(canvas).opacity") == "1", "never faded, as while its lamps load"
    tab.get_by_test_id("state").filter(has_text="Disarmed").wait_for()
    panel = view.locator(".mantine-Paper-root")
    assert tab.evaluate("innerWidth") < 640 or panel.first.is_visible()
    assert not view.locator("#webgl-software-rendering").is_visible()
    size = tab.viewport_size
    tab.set_viewport_size({"width": 600, "height": 800})
    panel.first.wait_for(state="hidden")
    tab.set_viewport_size(size)
