"""A viewer's own program at viser, behind the real front door: whatever it sends, it changes nothing and pushes nothing."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
import viser
import zstandard
from websockets import Origin, Subprotocol
from websockets.sync.client import ClientConnection, connect

from app.console.front_door import FrontDoor
from app.console.viewer import Viewer
from app.console.viewer_proxy import OPERATING
from app.people.sessions import Sessions
from app.people.users import Users
from cobra.loading import load_description
from cobra.messages import Push
from tests.app.console.scene_fakes import drives_of, state_of, wait_until
from tests.crowd import CAMERA
from tests.page_fakes import FakeSession, cookie_of

SRC_BOT = load_description("src-bot")
TRUTH = msgspec.msgpack.encode(
    {"vertebrae": [(0.0, 0.0, 0.045 * (i + 1)) for i in range(5)], "tip_wxyz": [1.0, 0.0, 0.0, 0.0]}
)
REFUSED = "message to viser that is not allowed"


class House:
    """A viewer of a robot with a twin, behind a door with users."""

    def __init__(self, folder: Path) -> None:
        self.pushes: list[Push] = []
        users = Users(folder / "users.json")
        self.people = {role: (role, users.add(role, role)) for role in ("viewer", "driver")}
        start = time.monotonic()
        self.viewer = Viewer(
            SRC_BOT,
            lambda: state_of(SRC_BOT, time.monotonic() - start, drives=drives_of(SRC_BOT)),
            truth=lambda: TRUTH,
            push=self.pushes.append,
        )
        self.viewer.start()
        sessions = Sessions(users, "host")
        self.door = FrontDoor(
            "127.0.0.1", 0, self.viewer.port, FakeSession(), viewer_secret=self.viewer.secret, sessions=sessions
        )
        self.door.start()

    def look(self, role: str) -> "Hand":
        return Hand(self.door.port, cookie_of(self.door.port, self.people[role]))

    def close(self) -> None:
        self.door.stop()
        self.viewer.stop()


class Hand:
    """viser's websocket by hand: what it was sent, and sending what a browser never would."""

    def __init__(self, port: int, cookie: str) -> None:
        self.connection: ClientConnection = connect(
            f"ws://127.0.0.1:{port}/viewer/",
            origin=Origin(f"http://127.0.0.1:{port}"),
            additional_headers={"cookie": cookie},
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
        )
        self.messages: list[dict[str, Any]] = []
        self.send(CAMERA)

    def send(self, message: dict[str, Any]) -> None:
        self.connection.send(msgspec.msgpack.encode(message))

    def read(self) -> list[dict[str, Any]]:
        frame = self.connection.recv(10)
        assert isinstance(frame, bytes)
        packed = frame[16 : 16 + int.from_bytes(frame[8:16], "little")]
        size = int.from_bytes(frame[:8], "little")
        window = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed, max_output_size=size))
        self.messages += window["messages"]
        return list(window["messages"])

    def read_until_joined(self) -> None:
        while not any(message["type"] == "ReplayDoneMessage" for message in self.read()):
            pass


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    house = House(tmp_path)
    yield house
    house.close()


def drag(phase: str) -> dict[str, Any]:
    here = {"start_position": (0.0, 0.0, 0.1), "end_position": (0.5, 0.0, 0.1)}
    screen = {"start_screen_pos": (0.5, 0.5), "end_screen_pos": (0.6, 0.5)}
    return {"type": "SceneNodeDragMessage", "phase": phase, "name": "/twin/guiders", "instance_index": 3, "button": "left",
            "modifier": None, "owner": "", **here, **screen}  # fmt: skip


def test_a_viewer_cannot_push_the_twin_and_a_driver_can(house: House) -> None:
    wait_until(lambda: house.viewer._twin is not None and house.viewer._twin.built)
    name = house.viewer._twin._guiders.name  # type: ignore[union-attr]
    for role in ("viewer", "driver"):
        hand = house.look(role)
        hand.read_until_joined()
        if role == "driver":  # who looks at the twin: else nobody's drag is asked for
            box = next(m for m in _until(hand, "the twin itself: drag to push"))
            hand.send({"type": "GuiUpdateMessage", "uuid": box["uuid"], "updates": {"value": True}})
        for phase in ("start", "update", "update"):
            hand.send({**drag(phase), "name": name})
        if role == "viewer":
            wait_until(lambda: house.door.counts[REFUSED] == 3)
            for _ in range(30):
                hand.read()
            assert house.pushes == []
        else:
            wait_until(lambda: bool(house.pushes))
            assert house.pushes[0].vertebra == 3
        hand.connection.close()


def _until(hand: Hand, label: str) -> Iterator[dict[str, Any]]:
    """The control with this label, once it is there."""
    while True:
        for message in hand.messages:
            if message.get("props", {}).get("label") == label:
                yield message
        hand.read()


def test_a_viewer_changes_no_control_whichever_it_names(house: House) -> None:
    with house.look("driver").connection:
        pass
    hand = house.look("viewer")
    hand.read_until_joined()
    before = {m["uuid"]: m for m in hand.messages if "uuid" in m}
    assert before
    sent = 0
    for uuid in before:
        for kind in sorted(OPERATING):
            updates = {"value": 99, "visible": False, "disabled": True, "removed": True, "update_cb": []}
            hand.send({"type": kind, "uuid": uuid, "updates": updates, "name": "/tube", "group_uuid": uuid})
            sent += 1
    hand.send({"type": "ShareUrlRequest"})
    hand.connection.send(b"\xc1")
    hand.connection.send("text")
    hand.connection.send(b"\x00" * 100_000)
    wait_until(lambda: house.door.counts[REFUSED] == sent + 4)
    # It goes on seeing what everybody sees, and so does who comes now.
    hand.read()
    late = house.look("viewer")
    late.read_until_joined()
    after = {m["uuid"]: m["props"] for m in late.messages if "uuid" in m and "props" in m}
    for uuid, props in after.items():
        if uuid in before and "props" in before[uuid]:
            assert (props["visible"], props.get("disabled")) == (
                before[uuid]["props"]["visible"],
                before[uuid]["props"].get("disabled"),
            )
    assert not house.viewer.errors
    hand.connection.close()
    late.connection.close()
