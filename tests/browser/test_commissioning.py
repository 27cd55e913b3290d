"""Commissioning in the page: a driver is led from motors that answer to a homed robot, and can end every step."""

from pathlib import Path

import pytest

from cobra.loading import description_text, load_description
from tests.browser.conftest import without_scene
from tests.stack import Stack

# A dozen steps of real drives in real time take a minute.
pytestmark = [pytest.mark.long, pytest.mark.timeout(400)]

TENDONS = load_description("cobra").tendon_names
CELL = """
[[load_cells]]
tendon = "{name}"
bus = "main"
frame_id = {frame}
scale_N = 0.01
rate_Hz = 50.0
noise_N = 0.03
bias_N = 0.5
"""


@pytest.fixture
def stack(tmp_path: Path):
    robot = tmp_path / "cobra.toml"
    cells = "".join(CELL.format(name=name, frame=0x300 + i) for i, name in enumerate(TENDONS))
    robot.write_text(description_text("cobra") + cells, "utf-8")
    started = Stack(tmp_path, robot="cobra")
    with started:
        yield started.start("--robot", str(robot))


def shot(tab, folder: Path, name: str) -> None:
    tab.screenshot(path=str(folder / f"{name}.png"))


def test_a_driver_is_led_through_all_steps(stack: Stack, tab, tmp_path: Path) -> None:
    without_scene(tab.context)
    tab.goto(stack.url)
    by = tab.get_by_test_id
    observer = stack.observer
    assert observer is not None
    tab.get_by_role("tab", name="Drives").click()
    by("commission-open").click()
    # Nobody knows its shape before it is homed, and none is shown.
    assert "–°" in tab.locator("#bends output").first.inner_text()
    assert by("commission-motors").locator("li.good").count() == 14
    shot(tab, tmp_path, "1-motors")

    by("commission-next").click()
    observer.wait("nothing in the way", lambda state: state.lease.fresh and not state.reasons)
    by("identify-E2").click()
    by("commission").get_by_text("E2 moves to and fro").wait_for()
    assert observer.state.phase == "commissioning"
    assert by("identify-S1").is_disabled()
    shot(tab, tmp_path, "2-identify")
    by("commission-found").get_by_text("E2 · moved").wait_for()
    assert observer.state.phase == "disarmed"

    by("commission-next").click()
    by("commission-test").click()
    by("commission-abort").click()
    by("commission").get_by_text("It was ended by the driver").wait_for()
    assert observer.state.phase == "holding"
    shot(tab, tmp_path, "4-ended")
    by("commission-off").click()
    observer.wait("the drives to be off", lambda state: state.phase == "disarmed")

    by("commission-next").click()
    assert by("commission").get_by_text("not tared yet").count() == len(TENDONS)
    by("commission-tare").click()
    by("commission-found").get_by_text("W3 · load cell").wait_for()
    shot(tab, tmp_path, "5-tared")
    assert all(not cell.trouble for cell in observer.wait("readings", lambda state: not state.cells[0].trouble).cells)

    by("commission-next").click()
    by("commission-home").click()
    observer.wait("homing", lambda state: state.phase == "commissioning")
    # STOP is never behind anything.
    by("stop").click()
    observer.wait("the stop", lambda state: state.phase == "stopped")
    by("commission").get_by_text("STOP").first.wait_for()
    # Nor is the head of the steps behind the alarm that it raises.
    alarms, panel = by("alarms").bounding_box(), by("commission").bounding_box()
    assert panel["y"] >= alarms["y"] + alarms["height"]
    shot(tab, tmp_path, "6-stopped")
    by("clear").click()
    observer.wait("the way", lambda state: state.phase == "holding")
    observer.wait("a driver", lambda state: state.lease.fresh and not state.reasons)
    by("commission-home").click()
    by("commission-found").get_by_text("S1 · spread").wait_for()
    shot(tab, tmp_path, "7-homed")
    state = observer.wait("ready", lambda state: state.phase == "ready" and state.homed)
    assert all(found.ok for found in state.commissioning.found), state.commissioning.found

    by("commission-next").click()
    by("commission").get_by_text("In use: version 2").wait_for()
    shot(tab, tmp_path, "8-done")
    by("commission-close").click()
    assert by("commission").is_hidden()
    # Beside the drives: what each cell measures, what its motor's current says, and how far they are apart.
    rows = by("cells").locator("tbody tr")
    assert rows.count() == len(TENDONS)
    cell, current = (float(rows.first.locator("td").nth(k).inner_text().split()[0]) for k in (1, 2))
    assert abs(cell - 8.0) < 1.0
    assert abs(current - cell) < 2.5
