"""The way to viser, against a real viser server."""

import contextlib
import threading
import time
from collections.abc import Iterator
from typing import Any

import httpx
import msgspec
import numpy as np
import psutil
import pytest
import viser
import zstandard
from viser import _messages
from websockets import Origin
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from app.console.front_door import FrontDoor
from app.console.viewer_proxy import LOOKING, OPERATING, may_pass
from tests.app.console.scene_fakes import wait_until
from tests.crowd import CAMERA
from tests.page_fakes import FakeSession, PageClient, cookie_of
from tests.slow_link import SlowLink

SUBPROTOCOL = f"viser-v{viser.__version__}"
SHARE = {"type": "ShareUrlRequest"}


@pytest.fixture(scope="module")
def viewer() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def door(viewer: viser.ViserServer, session: FakeSession) -> Iterator[FrontDoor]:
    with FrontDoor("127.0.0.1", 0, viewer.get_port(), session) as door:
        yield door


def look(
    port: int, path: str = "/viewer/", subprotocols: tuple[str, ...] = (SUBPROTOCOL,), origin: int = 0
) -> ClientConnection:
    """`origin`: the door's port, when `port` is that of a line to it."""
    return connect(
        f"ws://127.0.0.1:{port}{path}",
        origin=Origin(f"http://127.0.0.1:{port}"),
        additional_headers={"cookie": cookie_of(origin or port)},
        subprotocols=subprotocols or None,
        max_size=None,
    )


def fetch(door: FrontDoor, path: str) -> httpx.Response:
    return httpx.get(door.url + path, headers={"cookie": cookie_of(door.port)})


def send(connection: ClientConnection, message: dict[str, Any]) -> None:
    connection.send(msgspec.msgpack.encode(message))


def read_on(connection: ClientConnection) -> None:
    """Until it is closed."""
    while True:
        connection.recv(10)


@pytest.mark.parametrize("path", ["/viewer", "/viewer/", "/viewer/?darkMode&hideViserLogo", "/viewer/index.html"])
def test_visers_page_gets_our_script_ahead_of_its_own(door: FrontDoor, path: str) -> None:
    page = fetch(door, path[1:])
    ours = page.text.index("/static/js/viewer_frame.js")
    assert page.status_code == 200
    assert ours < page.text.index("<script", ours + 1)
    assert page.text.count("<script") > 1
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert "hasFocus" in fetch(door, "static/js/viewer_frame.js").text


def test_a_file_that_viser_does_not_have_is_not_found(door: FrontDoor) -> None:
    assert fetch(door, "viewer/no-such-file.js").status_code == 404


@pytest.mark.parametrize("path", ["/viewer", "/viewer/", "/viewer?darkMode"])
def test_the_scene_comes_through_as_viser_sends_it(door: FrontDoor, viewer: viser.ViserServer, path: str) -> None:
    with look(door.port, path) as client:
        assert client.subprotocol == SUBPROTOCOL
        assert client.response is not None
        assert "Sec-WebSocket-Extensions" not in client.response.headers, "no compression"
        vertices = np.arange(30_000, dtype=np.float32).reshape(-1, 3)
        viewer.scene.add_point_cloud("/marker", points=vertices, colors=(1, 2, 3), precision="float32")
        # viser appends arrays as they are; they arrive byte for byte.
        while vertices.tobytes() not in client.recv(10):
            pass


def test_visers_refusal_of_another_version_reaches_its_client(door: FrontDoor) -> None:
    with look(door.port, subprotocols=("viser-v0.0.1",)) as old, pytest.raises(ConnectionClosed) as closed:
        read_on(old)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1002


def test_a_share_request_never_reaches_viser_but_the_camera_does(door: FrontDoor, viewer: viser.ViserServer) -> None:
    arrived: list[str] = []
    looked = threading.Semaphore(0)

    def take(client: int, message: _messages.Message) -> None:
        arrived.append(type(message).__name__)
        if isinstance(message, _messages.ViewerCameraMessage):
            looked.release()

    kinds = (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect, _messages.ViewerCameraMessage)
    handlers = viewer._websock_server._incoming_handlers
    usual = {kind: handlers.pop(kind, []) for kind in kinds}
    for kind in kinds:
        viewer._websock_server.register_handler(kind, take)
    with look(door.port) as client:
        for message in (CAMERA, SHARE, {"type": "ShareUrlDisconnect"}, {**CAMERA, "type": "RunJavascriptMessage"}):
            send(client, message)
        client.send("text")
        client.send(b"\xc1 no msgpack")
        # Two types in one message: the filter must not read another one than viser does.
        camera, share = (msgspec.msgpack.encode(kind) for kind in (CAMERA["type"], SHARE["type"]))
        client.send(b"\x82\xa4type" + camera + b"\xa4type" + share)
        send(client, CAMERA)
        assert looked.acquire(timeout=10)
        assert looked.acquire(timeout=10)
    for kind in kinds:
        viewer._websock_server.unregister_handler(kind, take)
        handlers[kind].extend(usual[kind])
    assert arrived == ["ViewerCameraMessage"] * 2
    assert door.counts["message to viser that is not allowed"] == 6


def test_the_panels_work_through_the_door(door: FrontDoor, viewer: viser.ViserServer) -> None:
    slider = viewer.gui.add_slider("speed", min=0, max=10, step=1, initial_value=1)
    moved = threading.Event()
    slider.on_update(lambda event: moved.set())
    with look(door.port) as client:
        send(client, CAMERA)
        send(client, {"type": "GuiUpdateMessage", "uuid": slider._impl.uuid, "updates": {"value": 7}})
        assert moved.wait(10)
    assert slider.value == 7
    slider.remove()


def test_all_that_visers_client_may_send_is_on_a_list_but_the_share_tunnel(viewer: viser.ViserServer) -> None:
    known = {kind.__name__ for kind in viewer._websock_server._incoming_handlers}
    assert known >= {"GuiUpdateMessage", "TransformControlsUpdateMessage", "ScenePointerMessage"}
    assert known - LOOKING - OPERATING == {"ShareUrlRequest", "ShareUrlDisconnect"}


@pytest.mark.parametrize("kind", sorted(OPERATING | {"ShareUrlRequest", "RunJavascriptMessage", ""}))
def test_a_viewer_can_send_nothing_that_acts(kind: str) -> None:
    frame = msgspec.msgpack.encode({"type": kind, "uuid": "x", "updates": {"value": 1}})
    assert not may_pass(frame, "viewer")
    assert may_pass(frame, "driver") == (kind in OPERATING)


@pytest.mark.parametrize("frame", [b"", b"\xc1", b"\x80", b"\x81\xa4type\x01", b"\x91" * 5000, "text", bytes(100)])
def test_what_is_no_message_passes_for_nobody(frame: bytes | str) -> None:
    assert not may_pass(frame, "driver")


def test_without_viser_the_frame_says_so_and_tries_again(no_viewer_port: int, session: FakeSession) -> None:
    with FrontDoor("127.0.0.1", 0, no_viewer_port, session) as door:
        page = fetch(door, "viewer/")
        assert page.status_code == 503
        assert 'http-equiv="refresh"' in page.text
        with pytest.raises(InvalidStatus):
            look(door.port)
        assert door.counts["viser did not answer"] == 2


def test_a_viewer_is_cut_off_when_viser_ends(session: FakeSession) -> None:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    with FrontDoor("127.0.0.1", 0, server.get_port(), session) as door, look(door.port) as client:
        client.recv(10)
        server.stop()
        with pytest.raises(ConnectionClosed):
            read_on(client)


def test_a_viewer_that_stops_reading_is_cut_off_and_holds_nobody_up(
    door: FrontDoor, viewer: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.console.patience.STUCK_S", 0.3)
    monkeypatch.setattr("app.console.viewer_proxy.SLOWEST_B_S", 1e9)
    stuck = connect(
        f"ws://127.0.0.1:{door.port}/viewer/",
        origin=Origin(f"http://127.0.0.1:{door.port}"),
        additional_headers={"cookie": cookie_of(door.port)},
        subprotocols=[SUBPROTOCOL],
        max_size=None,
        max_queue=1,
        close_timeout=0.1,
    )
    own = stuck.socket.getsockname()[1]  # now: once it is cut off, its end may be closed already
    cloud = viewer.scene.add_point_cloud("/cloud", np.zeros((50_000, 3), np.float32), (1, 2, 3), precision="float32")
    with look(door.port) as reader:
        for i in range(1, 100):
            # Each is new, so that viser sends it, and as it is, so that it is known again.
            newest = np.full((50_000, 3), i, np.float32)
            cloud.points = newest
            while newest.tobytes() not in reader.recv(10):
                pass
            if door.counts["viewer does not read: cut off"]:
                break
            time.sleep(0.02)
        assert door.counts["viewer does not read: cut off"] == 1
        wait_until(lambda: door.people["views"] == 1)

        def connected() -> bool:
            return any(other.raddr and other.raddr.port == own for other in psutil.Process().net_connections())

        wait_until(lambda: not connected())
    cloud.remove()
    stuck.close()


def test_a_thin_view_is_another_viser_opened_when_first_asked_for(
    viewer: viser.ViserServer, session: FakeSession
) -> None:
    thin = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    thin.scene.add_frame("/thin")
    asked = []

    def address() -> tuple[int, str]:
        asked.append(1)
        return thin.get_port(), ""

    with FrontDoor("127.0.0.1", 0, viewer.get_port(), session, thin_viewer=address) as door:
        with look(door.port, "/viewer/p-page/") as full:
            full.recv(10)
        assert not asked
        with look(door.port, "/viewer/p-page/thin/tip/") as client:
            while b"/thin" not in _unpacked(client.recv(10)):
                pass
        assert asked == [1]
        assert fetch(door, "viewer/thin/tip/").status_code == fetch(door, "viewer/p-1/thin").status_code == 200
        assert fetch(door, "viewer/p-1/plain/thin/tip/").status_code == 200
        assert fetch(door, "viewer/thin/other").status_code == 404
    thin.stop()


def test_a_page_is_told_that_its_link_does_not_carry_its_view(
    door: FrontDoor, viewer: viser.ViserServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.console.viewer_proxy.WATCH_S", 0.2)
    cloud = viewer.scene.add_point_cloud("/cloud", np.zeros((20_000, 3), np.float32), (1, 2, 3), precision="float32")

    def behind(word: str) -> bool:
        with PageClient(door.port) as page:
            page.send({"type": "pace", "thin": False, "view": word})
            page.send({"type": "ping", "stamp": 1.0})
            return bool(page.next("pong")["behind"])

    with SlowLink(door.port, 200e3) as line, look(line.port, "/viewer/p-slow/", origin=door.port) as slow:
        reading = threading.Thread(target=_read_to_the_end, args=(slow,), daemon=True)
        reading.start()
        number = 0

        def told() -> bool:
            nonlocal number
            number += 1
            cloud.points = np.full((20_000, 3), number, np.float32)
            return behind("p-slow")

        wait_until(told)
        assert not behind("p-other")
    wait_until(lambda: not behind("p-slow"))
    cloud.remove()


def _unpacked(frame: bytes | str) -> bytes:
    assert isinstance(frame, bytes)
    packed = frame[16 : 16 + int.from_bytes(frame[8:16], "little")]
    return zstandard.ZstdDecompressor().decompress(packed, max_output_size=int.from_bytes(frame[:8], "little"))


def _read_to_the_end(connection: ClientConnection) -> None:
    with contextlib.suppress(ConnectionClosed, TimeoutError):
        read_on(connection)
