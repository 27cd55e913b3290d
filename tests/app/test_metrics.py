"""Claims about metrics and logs: what Prometheus scrapes is what the robot said, and whoever has no session gets nothing."""

import json
import logging
import math
import re
from pathlib import Path

import httpx
import msgspec
import pytest
from prometheus_client.parser import text_string_to_metric_families

from app import logs
from app.console.front_door import FrontDoor
from app.metrics import Metrics
from app.people.sessions import Sessions
from app.people.users import Users
from cobra.errors import OperatorError
from cobra.loading import load_description
from cobra.messages import Cell, RobotState, Timing
from tests.app.test_watching import state_of
from tests.page_fakes import FakeSession

DESCRIPTION = load_description("cobra")


class Robot:
    """A robot whose newest state is given."""

    def __init__(self, state: RobotState | None) -> None:
        self.state = state
        self.present = state is not None
        self.event_counts = {"alarm": 2}

    def latest(self) -> RobotState | None:
        return self.state

    def age(self) -> float:
        return 0.25 if self.state else math.inf


def scraped(robot: Robot) -> dict[tuple[str, frozenset[str]], float]:
    """Samples by name and label values, read back with Prometheus' own parser."""
    metrics = Metrics(
        lambda: {"cobra": robot},
        lambda name: DESCRIPTION,
        lambda: {"no session": 3},
        lambda: {"pages": 1},
        lambda: {"cobra": 0.014},
    )
    return {
        (sample.name.removeprefix("cobra_teleop_"), frozenset(sample.labels.values())): sample.value
        for family in text_string_to_metric_families(metrics.text().decode())
        for sample in family.samples
    }


def test_a_scrape_tells_what_the_state_says():
    base = state_of(DESCRIPTION, "cobra")
    loads = list(base.drives.load)
    tendon = DESCRIPTION.tendon_drives[3]
    loads[tendon] = 12.5
    voltage = (math.nan,) * len(loads)
    state = msgspec.structs.replace(
        base,
        phase="holding",
        drives=msgspec.structs.replace(base.drives, load=tuple(loads), voltage=voltage),
        timing=Timing(rate_Hz=100.0, period_p99=0.0104, late=1),
        drops={"old epoch": 4},
        bus={"late reply": 5},
        cells=(Cell(tendon="S1", tension=math.nan, from_current=7.5, reading=0.0, age=9.0, trouble="silent"),),
    )
    seen = scraped(Robot(state))
    assert seen["tension_newtons", frozenset({"cobra", DESCRIPTION.tendon_names[3]})] == 12.5
    # A dead cell is no tension at all, not one of nothing.
    assert seen.get(("load_cell_newtons", frozenset({"cobra", "S1"}))) != 0.0
    assert seen["load_cell_current_newtons", frozenset({"cobra", "S1"})] == 7.5
    assert seen["load_cell_trouble", frozenset({"cobra", "S1"})] == 1
    assert seen["phase", frozenset({"cobra", "holding"})] == 1
    assert seen["loop_period_seconds", frozenset({"cobra", "0.99"})] == 0.0104
    assert seen["command_round_trip_seconds", frozenset({"cobra"})] == 0.014
    assert seen["commands_dropped_total", frozenset({"cobra", "old epoch"})] == 4
    assert seen["frames_unusable_total", frozenset({"cobra", "late reply"})] == 5
    assert seen["events_total", frozenset({"cobra", "alarm"})] == 2
    assert seen["refused_total", frozenset({"no session"})] == 3
    assert seen["connected", frozenset({"pages"})] == 1
    assert seen["state_age_seconds", frozenset({"cobra"})] == 0.25
    assert not [name for name in seen if name[0] == "drive_voltage_volts"], "what is not known is no sample"


def test_a_robot_that_never_spoke_is_down_and_no_more():
    seen = scraped(Robot(None))
    assert seen["robot_up", frozenset({"cobra"})] == 0
    assert not [name for name in seen if name[0].startswith("drive")]


def test_the_dashboard_asks_for_metrics_that_there_are():
    state = msgspec.structs.replace(
        state_of(DESCRIPTION, "cobra"), drops={"x": 1}, bus={"x": 1}, timing=Timing(rate_Hz=100.0)
    )
    names = {name[0] for name in scraped(Robot(state))}
    dashboard = (Path(__file__).parents[2] / "docs" / "grafana-dashboard.json").read_text()
    asked = set(re.findall(r"cobra_teleop_([a-z0-9_]+)", dashboard))
    assert asked
    assert asked <= names


def test_metrics_need_a_session_or_name_and_token(tmp_path):
    users = Users(tmp_path / "users.json")
    token = users.add("prometheus", "viewer")
    metrics = Metrics(lambda: {}, lambda name: None, lambda: {}, lambda: {"pages": 0})
    with FrontDoor("127.0.0.1", 0, 1, FakeSession(), sessions=Sessions(users, "host"), metrics=metrics) as door:
        url = f"{door.url}metrics"
        assert httpx.get(url).status_code == 401
        assert httpx.get(url, auth=("prometheus", "wrong")).status_code == 401
        assert httpx.get(url, headers={"authorization": "Basic ???"}).status_code == 401
        answer = httpx.get(url, auth=("prometheus", token))
        assert "cobra_teleop_connected" in answer.text
        tries = [httpx.get(url, auth=("prometheus", "guess")).status_code for _ in range(8)]
        assert set(tries) == {401}
        assert httpx.get(url, auth=("prometheus", token)).status_code == 200, "who was right is not locked out"


@pytest.fixture
def log_folder(tmp_path, monkeypatch):
    monkeypatch.setenv("COBRA_TELEOP_STATE_DIR", str(tmp_path))
    root, ours = logging.getLogger(), logging.getLogger("cobra")
    before, level = [*root.handlers], ours.level
    yield tmp_path / "log"
    root.handlers[:] = before
    ours.setLevel(level)


def test_logs_of_all_processes_are_one_list_with_levels(log_folder, capsys):
    logs.start("console-cobra")
    logging.getLogger("cobra.console").warning("page 1 fell silent", extra={"page": 1})
    logging.getLogger("cobra.console").info("hello")
    logging.getLogger("cobra.console").debug("not said")
    logs.stop()
    (log_folder / "robot-cobra.jsonl").write_text(
        '{"time": 1.0, "level": "error", "process": "robot-cobra", "text": "x"}\n{"ti'
    )
    lines = list(logs.read())
    assert [line["text"] for line in lines] == ["x", "page 1 fell silent", "hello"]
    assert lines[1]["page"] == 1
    assert [line["text"] for line in logs.read("warning", since_s=2.0)] == ["page 1 fell silent"]
    assert logs.show("warning", 1.0) == 0
    assert capsys.readouterr().out.endswith("warning console-cobra: page 1 fell silent\n")


def test_a_fault_is_logged_with_its_trace_on_one_line():
    try:
        raise ValueError("no")
    except ValueError:
        record = logging.LogRecord("cobra.x", logging.ERROR, "", 0, "it %s", ("broke",), __import__("sys").exc_info())
    line = json.loads(logs.JsonLines("robot-cobra").format(record))
    assert line["text"] == "it broke"
    assert "ValueError: no" in line["trace"]


def test_an_unknown_level_is_refused(log_folder):
    with pytest.raises(OperatorError, match="debug, info, warning, error"):
        logs.start("x", "loud")
