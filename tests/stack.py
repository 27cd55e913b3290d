"""The real program in processes of its own, and a page that speaks the page's websocket, for tests."""

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Self
from urllib.parse import urlsplit

import msgspec
import numpy as np
import zenoh
from websockets.sync.client import connect

from app.link.console_end import ConsoleLink
from app.link.keys import key
from app.runtime import Running
from cobra.messages import RobotState
from tests.page_fakes import cookie_of

START_S = 60.0


def wait_for(what: str, condition: Callable[[], Any], timeout_s: float = 30.0) -> Any:
    """Wait until a condition holds; gives its value."""
    deadline = time.monotonic() + timeout_s
    while time.monotonic() < deadline:
        if value := condition():
            return value
        time.sleep(0.005)
    raise AssertionError(f"{what} did not come within {timeout_s:g} s")


class Stack:
    """`cobra-teleop` as a user starts it: console and robot process, with a runtime folder of its own."""

    program: tuple[str, ...] = ("-m", "app", "--no-pad")

    def __init__(self, folder: Path, *arguments: str, robot: str = "cobra") -> None:
        self.folder = folder
        self.robot = robot
        self.arguments = arguments
        own = {f"COBRA_TELEOP_{kind}_DIR": str(folder) for kind in ("RUNTIME", "CONFIG", "STATE", "DATA")}
        self.environment = {**os.environ, **own, "PYTHONUNBUFFERED": "1"}
        self.output = folder / "console.txt"
        self.process: subprocess.Popen[bytes] | None = None
        self.observer: Observer | None = None

    def start(self, *more: str) -> Self:
        command = [sys.executable, *self.program, "--robot", self.robot, "--port", "0", "--no-open"]
        with self.output.open("ab") as output:
            self.process = subprocess.Popen(
                [*command, *self.arguments, *more],
                env=self.environment,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # it gives its session precedence
            )
        self.url  # noqa: B018 - waits for it
        self.observer = self.observer or Observer(self.robot, self.running("robot").endpoint)
        return self

    def running(self, role: str) -> Running:
        """The entry of a role in the runtime folder, once it is there and alive."""

        def entry() -> Running | None:
            if self.process is not None and self.process.poll() is not None:
                raise AssertionError(f"the console ended: {self.output.read_text()}")
            with contextlib.suppress(OSError, msgspec.MsgspecError):
                found = msgspec.json.decode((self.folder / f"{role}-{self.robot}.json").read_bytes(), type=Running)
                return found if _alive(found.pid) else None
            return None

        return wait_for(f"the {role}", entry, START_S)

    @property
    def url(self) -> str:
        return self.running("console").endpoint

    def end(self) -> int:
        """Ctrl-C; gives the exit status."""
        assert self.process is not None
        self.process.send_signal(signal.SIGINT)
        return self.process.wait(20)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.observer:
            self.observer.close()
        pids = [self.process.pid] if self.process and self.process.poll() is None else []
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            entry = msgspec.json.decode((self.folder / f"robot-{self.robot}.json").read_bytes(), type=Running)
            pids.append(entry.pid)
        for pid in pids:
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        if self.process:
            self.process.wait(10)


class PadStack(Stack):
    """The console beside a virtual pad: such a pad exists only in the process that reads it."""

    program = (str(Path(__file__).parent / "console_with_pad.py"),)

    def pad(self, **request: Any) -> float:
        """Do something with the pad; gives the monotonic time at which it was done."""
        assert self.process is not None
        assert self.process.stdin is not None
        answered = self.output.read_text().count('{"pad"')
        self.process.stdin.write(json.dumps(request).encode() + b"\n")
        self.process.stdin.flush()

        def answer() -> str | None:
            lines = [line for line in self.output.read_text().splitlines() if line.startswith('{"pad"')]
            return lines[answered] if len(lines) > answered else None

        told = json.loads(wait_for(f"the pad's answer to {request}", answer))
        assert "error" not in told, told
        return float(told["time"])

    def arm(self) -> None:
        """Press Start when nothing is in the way, and wait until the robot is homed and ready."""
        observer = self.observer
        assert observer is not None
        observer.wait("nothing in the way", lambda state: state.lease.fresh and not state.reasons)

        def pressed() -> bool:
            # A pad that has only just come, or a machine that stalls, makes a press void: then a person presses again.
            self.pad(button="start", value=1)
            self.pad(button="start", value=0)
            with contextlib.suppress(AssertionError):
                observer.wait("arming", lambda state: state.phase != "disarmed", 2.0)
            return observer.state.phase != "disarmed"

        wait_for("arming", pressed)
        observer.wait("ready", lambda state: state.phase == "ready", 60.0)

    def press_dead_man(self) -> None:
        """Hold LB until the robot drives; a press in the very moment of getting ready is void, so press again then."""
        observer = self.observer
        assert observer is not None

        def pressed() -> bool:
            self.pad(button="leftshoulder", value=0)
            self.pad(button="leftshoulder", value=1)
            with contextlib.suppress(AssertionError):
                observer.wait("driving", lambda state: state.phase == "driving", 1.0)
            return observer.state.phase == "driving"

        wait_for("the drive", pressed)


class Observer:
    """Listens on the link: every state, and the twin's truth, which no controller sees."""

    def __init__(self, robot: str, endpoint: str) -> None:
        self.link = ConsoleLink(robot, endpoint)
        self.link.start()
        self.link.wait_for_state(START_S)
        self._truth: dict[str, Any] | None = None
        session = self.link._session
        assert session is not None
        self._subscriber = session.declare_subscriber(key(robot, "truth"), self._take)

    @property
    def state(self) -> RobotState:
        assert self.link.latest is not None
        return self.link.latest

    def wait(self, what: str, condition: Callable[[RobotState], Any], timeout_s: float = 30.0) -> RobotState:
        try:
            wait_for(what, lambda: condition(self.state), timeout_s)
        except AssertionError as error:
            state, events = self.state, [event.text for event in self.link.events]
            raise AssertionError(
                f"{error}; it is {state.phase}: {state.cause} {state.reasons}, after {events}"
            ) from None
        return self.state

    def truth(self) -> dict[str, Any]:
        """The newest truth of the twin that arrives from now on."""
        self._truth = None
        return wait_for("the twin's truth", lambda: self._truth, 5.0)

    def tip(self) -> np.ndarray:
        return np.array(self.truth()["tip_position"])

    def settled_tip(self) -> np.ndarray:
        """The twin's tip once it stands still to a tenth of a millimetre."""
        before = self.tip()

        def still() -> bool:
            nonlocal before
            now = [self.tip() for _ in range(10)][-1]
            moved, before = float(np.linalg.norm(now - before)), now
            return moved < 1e-4

        wait_for("the twin's rest", still)
        return before

    def close(self) -> None:
        self.link.stop()

    def _take(self, sample: zenoh.Sample) -> None:
        self._truth = msgspec.msgpack.decode(sample.payload.to_bytes())


class Page:
    """Speaks the operator's page's websocket: controls at 50 Hz from a thread, requests with their answers.

    Without a `user` (name, token) it comes as a browser does to a console without users: it opens the page first.
    """

    def __init__(self, url: str, user: tuple[str, str] | None = None) -> None:
        cookie = cookie_of(urlsplit(url).port or 80, user)
        self._socket = connect(
            url.replace("http", "ws") + "ws", origin=url.rstrip("/"), additional_headers={"cookie": cookie}
        )
        self._lock = threading.Lock()
        self._quit = threading.Event()
        self._answers: dict[int, dict[str, Any]] = {}
        self._controls: dict[str, Any] = {}
        self._sequence = self._ids = 0
        self.snapshot: dict[str, Any] = {}
        self.welcome: dict[str, Any] = {}
        self.release()
        self._threads = [threading.Thread(target=body, daemon=True) for body in (self._listen, self._stream)]
        for thread in self._threads:
            thread.start()
        # A page must have been seen to hold nothing before it may press.
        wait_for("the first snapshot and controls", lambda: self.snapshot and self._sequence > 2)

    def hold(self, **controls: Any) -> None:
        """Hold the dead-man with these controls: left, right, lt, rt, buttons."""
        with self._lock:
            self._controls = {**_REST, **controls, "held": True}

    def move(self, **controls: Any) -> float:
        """As `hold`, and sent at once, as a browser does on a change; gives the monotonic time just before."""
        self.hold(**controls)
        with self._lock:
            self._sequence += 1
            now = time.monotonic()
            echo = self.snapshot.get("stamp", 0.0)
            self._send({"type": "controls", "seq": self._sequence, "stamp": now * 1e3, "echo": echo, **self._controls})
        return now

    def release(self) -> None:
        with self._lock:
            self._controls = {**_REST, "held": False}

    def ask(self, what: str, value: int | None = None, text: str = "") -> dict[str, Any]:
        with self._lock:
            self._ids += 1
            number = self._ids
            self._send({"type": "act", "id": number, "what": what, "value": value, "text": text})
        return wait_for(f"the answer to {what}", lambda: self._answers.pop(number, None))

    def arm(self) -> None:
        """Arm and wait until it is homed and ready."""
        wait_for(
            "nothing in the way of arming", lambda: self.snapshot["lease"]["fresh"] and not self.snapshot["reasons"]
        )
        answer = self.ask("arm")
        assert answer["ok"], answer
        self.until_phase("ready")

    def until_phase(self, phase: str, timeout_s: float = 40.0) -> None:
        wait_for(f"phase {phase}", lambda: self.snapshot["phase"] == phase, timeout_s)

    def press(self, timeout_s: float = 40.0) -> None:
        """Hold until it drives; a press that a stall of the machine made void is made again."""

        def pressed() -> bool:
            self.release()
            # The robot must have heard of the release: one that is pressed over within a period was never sent.
            sent = self._sequence
            wait_for("the release", lambda: self._sequence > sent + 1, timeout_s)
            wait_for("standing still", lambda: self.snapshot["phase"] in ("ready", "holding"), timeout_s)
            self.hold()
            with contextlib.suppress(AssertionError):
                self.until_phase("driving", 2.0)
            return self.snapshot["phase"] == "driving"

        wait_for("the drive", pressed, timeout_s)

    def drive_until(self, reached: Callable[[], bool], **controls: Any) -> None:
        """Drive with these controls until `reached`, and let go; a drive that a stall of the machine ended is begun again."""

        def there() -> bool:
            if self.snapshot["phase"] != "driving":
                self.press()
            self.hold(**controls)
            return reached()

        wait_for("the way", there, 40.0)
        self.release()
        self.until_phase("ready")

    def close(self) -> None:
        self._quit.set()
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _stream(self) -> None:
        with contextlib.suppress(Exception):
            while not self._quit.wait(0.02):
                with self._lock:
                    self._sequence += 1
                    echo = self.snapshot.get("stamp", 0.0)
                    head = {"type": "controls", "seq": self._sequence, "stamp": time.monotonic() * 1e3, "echo": echo}
                    self._send({**head, **self._controls})

    def _listen(self) -> None:
        with contextlib.suppress(Exception):
            for text in self._socket:
                message = json.loads(text)
                if message["type"] == "snapshot":
                    self.snapshot = message
                elif message["type"] == "welcome":
                    self.welcome = message
                elif message["type"] == "reply":
                    self._answers[message["id"]] = message

    def _send(self, message: dict[str, Any]) -> None:
        self._socket.send(json.dumps(message))


_REST: dict[str, Any] = {"left": [0, 0], "right": [0, 0], "lt": 0, "rt": 0, "buttons": []}


def _alive(pid: int) -> bool:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    return False


@contextlib.contextmanager
def running(folder: Path, *arguments: str, robot: str = "cobra") -> Iterator[Stack]:
    """The program, started and ready, ended afterwards whatever happens."""
    with Stack(folder, *arguments, robot=robot) as stack:
        stack.start()
        yield stack
