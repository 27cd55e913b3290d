"""For the front door's tests: a robot that stands still and remembers all that it was told, and a page."""

import http.client
import json
import math
import threading
from collections.abc import Awaitable, Callable
from typing import Any, Self
from urllib.parse import urlencode

from websockets import Origin
from websockets.sync.client import connect

from app.console.commissioning_view import commissioning_state
from app.console.guides import guides
from app.console.inputs import Controls
from app.console.mapping import DEAD_MAN, FRAMES
from app.console.motion_state import guide_state
from app.console.page_socket import Asker
from app.console.page_state import Answer, Snapshot, Welcome
from app.people.audit import Deed
from cobra.loading import load_description

TENDONS = [f"{side}{section}" for section in (1, 2, 3) for side in "SENW"]


class FakeSession:
    """Implements `PageSession`. `seen` wakes up whoever waits for something to arrive."""

    def __init__(self) -> None:
        self.seen = threading.Condition()
        self.received: list[tuple[str, int, Controls]] = []
        self.acts: list[tuple[str, str, int | None]] = []
        self.texts: list[str] = []
        self.askers: list[str] = []
        self.signed: list[tuple[str, str]] = []
        self.ended: list[str] = []
        self.changes: dict[str, Any] = {}
        self.facts: dict[str, Any] = {}
        self.before_snapshot: Callable[[], None] = lambda: None
        self.answer: Callable[[str, int | None], Answer | Awaitable[Answer]] = lambda what, value: Answer(
            ok=True, reasons=[]
        )

    # ------------------------------------------------------------------ what the front door calls

    def welcome(self) -> Welcome:
        facts: Any = {
            "robot": "cobra",
            "title": "COBRA",
            "summary": "Three bending sections, twist and feed.",
            "sections": ["base", "middle", "tip"],
            "bending": [0, 1, 2],
            "limits": {"twist_deg": (-180.0, 180.0), "feed_mm": (0.0, 1000.0), "length_mm": None},
            "speed_levels": [0.25, 0.5, 1.0],
            "tendons": TENDONS,
            "max_tension_N": 60.0,
            "modes": [guide_state(guide) for guide in guides(load_description("cobra"))],
            "frames": list(FRAMES),
            "active_length_mm": 300.0,
            "hand_fed": False,
            "versions": {"cobra-teleop": "0.1.0"},
            "danger": "",
            "elsewhere": "",
        }
        return {**facts, **self.facts}

    def snapshot(self) -> Snapshot:
        self.before_snapshot()
        snapshot: Any = {
            "phase": "ready",
            "cause": "",
            "hints": {},
            "reasons": [],
            "homed": True,
            "channels": [{"name": "main", "load": 0.41, "trouble": ""}],
            "notes": ["bus 'main': rmd-v1 drives have no watchdog: they hold their last setpoint"],
            "link": {"ok": True, "robot": True, "age_ms": 6.2, "trip_ms": 14.0},
            "lease": {"holder": "console", "since_s": 12.0, "fresh": True, "asking": []},
            "seat": {"shared": True, "page": "", "console_pad": True},
            "people": [{"name": "host", "role": "admin"}],
            "driver": "",
            "pad": {
                "name": "",
                "connected": False,
                "controls": {"left": (0.0, 0.0), "right": (0.0, 0.0), "lt": 0.0, "rt": 0.0, "buttons": []},
            },
            "mode": "section",
            "frame": "world",
            "motion": {
                "words": [],
                "share": 1.0,
                "fallbacks": 0,
                "path": None,
                "poses": ["inspect", "home"],
                "pose": "",
                "hand_feed": None,
            },
            "section": 0,
            "speed": 1,
            "bends": [
                {"name": name, "deg": deg, "dir_deg": direction, "limit_deg": 90.0}
                for name, deg, direction in (("base", 22.5, -60.0), ("middle", 78.0, 20.0), ("tip", 89.9, 160.0))
            ],
            "twist_deg": -31.0,
            "feed_mm": 300.0,
            "length_mm": None,
            "lock": {"status": "none", "words": ""},
            "commissioning": commissioning_state(None),
            "tendons": {"compensation": "none", "words": "", "warnings": []},
            "tip_mm": [41.2, -18.7, 262.4],
            "tensions": [2.0 + 28.0 * (1 + math.sin(i)) for i in range(12)],
            "profiles": [],
            "tension_limits": {"min": 0.5, "max": 60.0},
            "drives": [
                {
                    "name": name,
                    "moves": "tendon" if name in TENDONS else name,
                    "temperature": 31.0,
                    "voltage": 24.1,
                    "load": 2.0,
                    "age_ms": 4.0,
                    "current": 0.31,
                    "missed": 0,
                    "warning": "",
                    "fault": "",
                }
                for name in (*TENDONS, "twist", "feed")
            ],
            "drops": {},
            "bus": {},
            "timing": {
                "rate_Hz": 100.0,
                "period_p50": 0.01,
                "period_p99": 0.0104,
                "period_max": 0.012,
                "compute_p99": 0.0011,
                "late": 0,
                "realtime": True,
            },
            "events": [{"level": "info", "text": "homed", "ago": 12.0}],
            "console_rate": 50.0,
        }
        return {**snapshot, **self.changes}

    def controls(self, page: str, sequence: int, controls: Controls) -> None:
        with self.seen:
            self.received.append((page, sequence, controls))
            self.seen.notify_all()

    def gone(self, page: str) -> None:
        with self.seen:
            self.ended.append(page)
            self.seen.notify_all()

    def act(self, asker: Asker, what: str, value: int | None, text: str) -> Answer | Awaitable[Answer]:
        with self.seen:
            self.acts.append((asker.page, what, value))
            self.askers.append(asker.visitor.name)
            self.texts.append(text)
            self.seen.notify_all()
        return self.answer(what, value)

    def opened(self, asker: Asker) -> None:
        pass

    def closed(self, page: str) -> None:
        pass

    async def audit(self) -> list[Deed]:
        return [Deed(time="2026-01-02T03:04:05.678Z", who="anna", what="took the controls")]

    def note_session(self, what: str, name: str, address: str) -> None:
        with self.seen:
            self.signed.append((what, name))
            self.seen.notify_all()

    # ------------------------------------------------------------------ what the tests ask

    def wait(self, condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
        """Until the condition holds; it is looked at whenever something arrives."""
        with self.seen:
            assert self.seen.wait_for(condition, timeout_s), f"did not happen within {timeout_s} s"

    @property
    def newest(self) -> Controls:
        return self.received[-1][2] if self.received else Controls()

    @property
    def held(self) -> bool:
        return DEAD_MAN in self.newest.buttons

    @property
    def requests(self) -> list[str]:
        return [what for _, what, _ in self.acts]


def cookie_of(port: int, user: tuple[str, str] | None = None) -> str:
    """The cookie that a browser has: after opening the page, or after signing in as (name, token)."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    if user is None:
        connection.request("GET", "/")
    else:
        form = urlencode({"name": user[0], "token": user[1]})
        connection.request("POST", "/sign-in", form, {"content-type": "application/x-www-form-urlencoded"})
    response = connection.getresponse()
    response.read()
    connection.close()
    return (response.getheader("set-cookie") or "").partition(";")[0]


class PageClient:
    """The page's websocket as a hostile or honest program would speak it; without a cookie it opens the page first."""

    def __init__(self, port: int, cookie: str | None = None) -> None:
        self._connection = connect(
            f"ws://127.0.0.1:{port}/ws",
            origin=Origin(f"http://127.0.0.1:{port}"),
            additional_headers={"cookie": cookie_of(port) if cookie is None else cookie},
        )
        self.welcome = self.next("welcome")
        self.snapshot = self.next("snapshot")
        self.sequence = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._connection.close()

    def send_raw(self, data: str | bytes) -> None:
        self._connection.send(data)

    def send(self, message: dict[str, Any]) -> None:
        self.send_raw(json.dumps(message))

    def next(self, kind: str) -> dict[str, Any]:
        """The next message of a kind; others on the way are passed over, but the newest snapshot is kept."""
        while True:
            message = json.loads(self._connection.recv(10))
            if message["type"] == "snapshot":
                self.snapshot = message
            if message["type"] == kind:
                return message

    def read_until_closed(self) -> None:
        """Read on until the server closes."""
        while True:
            self.next("snapshot")

    def controls(self, **changes: Any) -> dict[str, Any]:
        """A valid message at rest, with changes; the next sequence number and the newest stamp unless given."""
        self.sequence += 1
        echo = changes["echo"] if "echo" in changes else self.next("snapshot")["stamp"]
        return {
            "type": "controls",
            "seq": self.sequence,
            "stamp": 1.0,
            "echo": echo,
            "left": [0, 0],
            "right": [0, 0],
            "lt": 0,
            "rt": 0,
            "buttons": [],
            "held": False,
            **changes,
        }

    def drive(self, **changes: Any) -> None:
        self.send(self.controls(**changes))

    def settle(self) -> None:
        """Until everything sent so far has been taken."""
        self.send({"type": "ping", "stamp": 5.0})
        assert self.next("pong")["stamp"] == 5.0
