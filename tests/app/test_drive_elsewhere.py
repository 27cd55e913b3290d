"""A console on another machine than its robot: router with TLS and accounts, robot process and console, each a real process."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
import trustme

from app.recording.reader import Recording
from app.router import add_account
from app.runtime import Running, any_free_port
from tests.stack import Observer, Page, Stack, wait_for

# Half a minute of starting processes; what they say to each other has quick tests in test_router.py.
pytestmark = pytest.mark.long


class Site:
    """A folder that stands for a machine: what runs there knows nothing of what runs elsewhere."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder
        own = {f"COBRA_TELEOP_{kind}_DIR": str(folder) for kind in ("RUNTIME", "CONFIG", "STATE", "DATA")}
        self.environment = {**os.environ, **own, "PYTHONUNBUFFERED": "1"}
        self.output = folder / "output.txt"

    def run(self, *arguments: str) -> "subprocess.Popen[bytes]":
        with self.output.open("ab") as output:
            return subprocess.Popen(
                [sys.executable, "-m", "app", *arguments],
                env=self.environment, stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
            )  # fmt: skip


class Network:
    """Three machines: the router's, the robot's, the operator's."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.endpoint = f"tls/localhost:{any_free_port()}"
        authority = trustme.CA()
        issued = authority.issue_cert("localhost")
        authority.cert_pem.write_to_path(str(folder / "ca.pem"))
        (folder / "router.pem").write_bytes(b"".join(blob.bytes() for blob in issued.cert_chain_pems))
        issued.private_key_pem.write_to_path(str(folder / "router.key"))
        for name, role in (("cobra", "robot"), ("anna", "driver"), ("wall", "viewer")):
            add_account(folder / "accounts.json", name, role, folder / f"{name}.account")
        self._between, self._robots = Site(folder / "router"), Site(folder / "robot")

    def __enter__(self) -> "Network":
        with contextlib.ExitStack() as stack:
            self._start(stack)
            self._ends = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.close()

    def _start(self, stack: contextlib.ExitStack) -> None:
        self.router: subprocess.Popen[bytes] | None = None
        stack.callback(lambda: _kill(self.router))
        self.route()
        self.robot = self._robots.run(
            "robot", "--twin", "ideal", "--router", self.endpoint, *self.access("cobra"), "--orphaned-after", "600"
        )
        stack.callback(lambda: _kill(self.robot))
        entry = self._robots.folder / "robot-cobra.json"
        wait_for("the robot process", lambda: entry.exists() or self.robot.poll() is not None, 60.0)
        assert self.robot.poll() is None, self._robots.output.read_text()
        self.observer = Observer("cobra", msgspec.json.decode(entry.read_bytes(), type=Running).endpoint)
        stack.callback(self.observer.close)

    def access(self, account: str) -> tuple[str, ...]:
        return ("--account", str(self.folder / f"{account}.account"), "--ca", str(self.folder / "ca.pem"))

    def route(self) -> None:
        files = {"accounts": "accounts.json", "tls-cert": "router.pem", "tls-key": "router.key"}
        words = [word for name, file in files.items() for word in (f"--{name}", str(self.folder / file))]
        before = len(self._between.output.read_text()) if self._between.output.exists() else 0
        self.router = self._between.run("router", "serve", "--listen", self.endpoint, *words)
        wait_for("the router", lambda: "Routing on" in self._between.output.read_text()[before:], 60.0)

    def cut(self) -> None:
        _kill(self.router)


def _kill(process: "subprocess.Popen[bytes] | None") -> None:
    if process is not None:
        process.kill()
        process.wait()


class ConsoleElsewhere(Stack):
    """`cobra-teleop drive`, on a machine of its own."""

    def __init__(self, network: Network, account: str) -> None:
        folder = network.folder / f"{account}-console"
        folder.mkdir()
        super().__init__(folder, *network.access(account))
        self.program = ("-m", "app", "drive", network.endpoint, "--no-pad")
        self.observer = network.observer

    @property
    def url(self) -> str:
        entry = self.folder / "console-cobra-elsewhere.json"
        assert self.process is not None
        wait_for("the console", lambda: entry.exists() or self.process.poll() is not None, 60.0)
        assert self.process.poll() is None, self.output.read_text()
        return msgspec.json.decode(entry.read_bytes(), type=Running).endpoint

    def __exit__(self, *_: object) -> None:
        if self.process and self.process.poll() is None:
            self.process.kill()
            self.process.wait()


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Network]:
    with Network(tmp_path_factory.mktemp("network")) as network:
        yield network


def test_it_drives_stops_records_and_leaves_the_robot_running(network: Network) -> None:
    observer = network.observer
    with ConsoleElsewhere(network, "anna") as console:
        console.start()
        with Page(console.url) as page:
            assert page.welcome["elsewhere"] == network.endpoint
            wait_for("the controls", lambda: page.snapshot["lease"]["fresh"] and not page.snapshot["reasons"])
            wait_for("the way to the robot", lambda: page.snapshot["link"]["trip_ms"])
            assert 0 < page.snapshot["link"]["trip_ms"] < 1000
            answer = page.ask("restart_robot")
            assert not answer["ok"]
            assert answer["reasons"] == [
                f"the robot process runs elsewhere, behind {network.endpoint}: restart it on its own machine"
            ]
            wait_for("the recording", lambda: page.snapshot["recording"]["megabytes"] > 0)
            assert page.ask("arm")["ok"]
            observer.wait("homing", lambda state: state.phase == "homing")
            assert page.ask("stop")["ok"]
            observer.wait("the stop", lambda state: state.phase == "stopped")
            assert page.ask("clear")["ok"]
            observer.wait("cleared", lambda state: state.phase != "stopped")
            page.ask("disarm")
            observer.wait("disarmed", lambda state: state.phase == "disarmed")

            # The network between them is cut, and mended.
            network.cut()
            wait_for("word of it", lambda: not page.snapshot["link"]["ok"])
            observer.wait("the lost driver", lambda state: not state.lease.fresh)
            network.route()
            wait_for("the way back", lambda: page.snapshot["link"]["ok"] and page.snapshot["lease"]["fresh"])
        assert console.end() == 0
        written = next(console.folder.glob("recordings/*.mcap"))
        assert "driven through tls/localhost" in console.output.read_text()
    assert network.robot.poll() is None, "the robot's process is not the console's to end"
    observer.wait("free controls", lambda state: not state.lease.fresh)
    with Recording(written) as recording:
        phases = {state.phase for _, state in recording.states()}
    assert {"disarmed", "homing", "stopped"} <= phases


def test_a_viewers_account_starts_a_console_that_can_only_look_and_stop(network: Network) -> None:
    with ConsoleElsewhere(network, "wall") as console:
        console.start("--no-record")
        with Page(console.url) as page:
            wait_for("states", lambda: page.snapshot["link"]["ok"])
            before = network.observer.state.accepted
            page.hold(left=[1, 0])
            assert "may only watch" in page.ask("arm")["reasons"][0]
            assert network.observer.state.accepted == before
            assert network.observer.state.lease.holder == ""
