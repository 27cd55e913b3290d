"""The 3D view as a service: always the newest state, never ended by a bad one, and each viewer's choices its own."""

import math
import socket
import threading

import httpx
import numpy as np
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from app.console.client_view import FILLED
from app.console.viewer import STALE_S, Viewer
from app.console.viewer_proxy import SECRET_HEADER, VIEW_HEADER
from cobra.clock import ManualClock
from cobra.kinematics.configuration import FEED
from tests.app.console.scene_fakes import COBRA, ViserClient, state_of, wait_until


class Robot:
    """What the link would give: the newest state, or none."""

    def __init__(self):
        self.state = None

    def latest(self):
        return self.state


@pytest.fixture
def robot():
    return Robot()


@pytest.fixture
def clock():
    return ManualClock()


@pytest.fixture
def stepped(robot, clock):
    """A viewer without a thread, on a clock that moves when it is told to."""
    viewer = Viewer(COBRA, robot.latest, clock=clock)
    viewer.open()
    yield viewer
    viewer.stop()


@pytest.fixture
def running(robot):
    robot.state = state_of()
    viewer = Viewer(COBRA, robot.latest, rate_Hz=100.0)
    viewer.start()
    yield viewer
    viewer.stop()


def notice_of(client):
    """The notice's last text."""
    texts = [
        message["updates"]["text"]
        for message in client.messages
        if message["type"] == "SceneNodeUpdateMessage" and message["name"] == "/notice" and "text" in message["updates"]
    ]
    return texts[-1] if texts else ""


def names(client, kind):
    return [message["name"] for message in client.messages if message["type"] == kind]


def test_it_draws_at_the_rate_it_is_stepped(stepped, robot, clock):
    for frame in range(30):
        robot.state = state_of(t=frame / 30.0)
        stepped.step()
        clock.advance(1.0 / 30.0)
    assert stepped.frame_rate == pytest.approx(30.0)
    assert not stepped.errors


def test_before_the_first_state_it_waits_without_an_error(stepped, clock):
    for _ in range(5):
        stepped.step()
        clock.advance(1.0)
    assert not stepped.errors


def test_a_bad_state_is_counted_and_the_next_good_one_drawn(stepped, robot, clock):
    robot.state = state_of(t=0.0)
    stepped.step()
    for bad in (state_of(t=1.0, measured=(math.nan,) * 8), state_of(t=1.1, measured=(1.0,))):
        robot.state = bad
        clock.advance(0.03)
        stepped.step()
    assert stepped.errors == {"measured: not finite": 1, "measured: 1 entries, 8 are needed": 1}
    with ViserClient(stepped) as client:
        wait_until(lambda: stepped.viewers == 1)
        client.drain()
        robot.state = state_of(t=2.0)
        clock.advance(0.03)
        stepped.step()
        client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and m["name"] == "/tube")


def test_old_data_are_said_to_be_old_and_new_ones_take_that_back(stepped, robot, clock):
    with ViserClient(stepped) as client:
        robot.state = state_of(t=0.0)
        stepped.step()
        clock.advance(STALE_S - 0.05)
        stepped.step()
        client.drain()
        assert "no data" not in notice_of(client)
        clock.advance(0.85)
        stepped.step()
        client.wait_for(lambda m: m["type"] == "SceneNodeUpdateMessage" and m["name"] == "/notice")
        assert notice_of(client) == f"no data for {STALE_S + 0.8:.1f} s"
        client.drain()
        robot.state = state_of(t=0.01)
        stepped.step()
        hidden = client.wait_for(lambda m: m["type"] == "SetSceneNodeVisibilityMessage" and m["name"] == "/notice")
        assert hidden["visible"] is False


def test_a_fault_in_the_source_of_states_is_counted_and_survived():
    told = threading.Semaphore(0)

    def broken():
        told.release()
        raise OSError("the link is gone")

    viewer = Viewer(COBRA, broken, rate_Hz=200.0)
    viewer.start()
    for _ in range(5):
        assert told.acquire(timeout=5.0)
    viewer.stop()
    assert viewer.errors["frame: OSError"] >= 4


def test_it_listens_on_loopback_only_and_stops_completely(robot):
    viewer = Viewer(COBRA, robot.latest)
    with pytest.raises(RuntimeError, match="start"):
        _ = viewer.port
    viewer.start()
    port = viewer.port
    assert viewer._running().get_host() == "127.0.0.1"
    with ViserClient(viewer) as client:
        client.wait_for(lambda m: m["type"] == "MeshMessage" and m["name"] == "/tube")
        viewer.stop()
    assert "viewer" not in {thread.name for thread in threading.enumerate()}
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", port), timeout=1.0)


@pytest.mark.parametrize("shown", ["", "guess", None])
def test_other_users_of_this_machine_do_not_get_past_the_front_door(robot, shown):
    viewer = Viewer(COBRA, robot.latest)
    viewer.open()
    headers = {} if shown is None else {SECRET_HEADER: shown}
    assert httpx.get(f"http://127.0.0.1:{viewer.port}/", headers=headers).status_code == 403
    with pytest.raises(InvalidStatus) as refused:
        connect(f"ws://127.0.0.1:{viewer.port}", subprotocols=["viser-v1.1.1"], additional_headers=headers)
    assert refused.value.response.status_code == 403
    assert httpx.get(f"http://127.0.0.1:{viewer.port}/", headers={SECRET_HEADER: viewer.secret}).status_code == 200
    viewer.stop()


def test_a_viewer_that_has_stopped_reading_does_not_hold_up_the_end():
    drawn = []

    def moving():
        drawn.append(state_of(t=0.01 * len(drawn)))
        return drawn[-1]

    viewer = Viewer(COBRA, moving, rate_Hz=100.0)
    viewer.start()
    with ViserClient(viewer, inbox=1):
        wait_until(lambda: viewer.viewers == 1)
        joined = len(drawn)
        wait_until(lambda: len(drawn) > joined + 60)
        thread = viewer._running()._websock_server._server_thread
        viewer.stop()
        assert not thread.is_alive()


def test_nothing_is_printed(robot, capsys):
    viewer = Viewer(COBRA, robot.latest)
    viewer.start()
    with ViserClient(viewer):
        wait_until(lambda: viewer.viewers == 1)
    viewer.stop()
    assert capsys.readouterr() == ("", "")


def test_nobody_can_have_it_open_a_public_tunnel(running):
    with ViserClient(running) as client:
        client.send("ShareUrlRequest")
        wait_until(lambda: running.viewers == 1)
        client.set("tendons", False)
        client.wait_for(lambda m: m["type"] == "FrameMessage" and m["name"] == "/tendons")
        assert running._running()._share_tunnel is None
        assert "ShareUrlUpdated" not in {message["type"] for message in client.messages}


def test_what_one_viewer_hides_the_others_still_see(running):
    with ViserClient(running) as one, ViserClient(running) as other:
        wait_until(lambda: running.viewers == 2)
        one.set("tendons", False)
        cover = one.wait_for(lambda m: m["type"] == "FrameMessage" and m["name"] == "/tendons")
        assert cover["props"]["show_axes"] is False
        one.set("tendons", True)
        one.wait_for(lambda m: m["type"] == "RemoveSceneNodeMessage" and m["name"] == "/tendons")
        other.drain()
        assert "/tendons" not in names(other, "FrameMessage")
        assert "/tendons" not in names(other, "RemoveSceneNodeMessage")


def test_the_camera_rides_on_the_tip_for_the_viewer_who_asks_for_it(running, robot):
    with ViserClient(running) as one, ViserClient(running) as other:
        wait_until(lambda: running.viewers == 2)
        one.set("camera", "from the tip")
        one.wait_for(lambda m: m["type"] == "FrameMessage" and m["name"] == "/frame")
        robot.state = state_of(t=2.0)
        tip = running._scene.body.backbone.tip(np.array(robot.state.measured))

        def at_the_tip(message):
            return message["type"] == "SetCameraPositionMessage" and np.allclose(message["position"], tip[:3, 3])

        one.wait_for(at_the_tip)

        def looking_ahead(message):
            if message["type"] != "SetCameraLookAtMessage":
                return False
            ahead = np.array(message["look_at"]) - tip[:3, 3]
            return bool(np.allclose(ahead / np.linalg.norm(ahead), tip[:3, 2], atol=1e-5))

        one.wait_for(looking_ahead)
        one.wait_for(
            lambda m: m["type"] == "SetCameraUpDirectionMessage" and np.allclose(m["position"], -tip[:3, 1], atol=1e-5)
        )
        other.drain()
        assert "SetCameraFovMessage" not in {message["type"] for message in other.messages}


def test_the_view_goes_along_with_what_is_fed_from_where_its_viewer_has_turned_it(running, robot):
    def fed(length_m):
        straight = np.zeros(len(state_of().measured))
        straight[FEED] = length_m
        return state_of(measured=tuple(straight), commanded=tuple(straight))

    def stands(message, place):
        return message["type"] == "SetCameraPositionMessage" and np.allclose(message["position"], place, atol=0.006)

    turned = np.ones(3)  # where the client says that it is
    with ViserClient(running) as client:
        wait_until(lambda: running.viewers == 1)
        robot.state = fed(FILLED * COBRA.active_length_m + 0.5)
        client.wait_for(lambda m: stands(m, turned + np.array([0.0, 0.0, 0.5])))
        robot.state = fed(0.1)
        client.wait_for(lambda m: stands(m, turned))


def test_shadows_are_left_out_for_the_viewer_whose_computer_draws_in_software(running):
    def last_shadows(client):
        return [m["cast_shadow"] for m in client.messages if m["type"] == "EnableLightsMessage"][-1:]

    with ViserClient(running) as fine, ViserClient(running, **{VIEW_HEADER: "plain"}) as plain:
        plain.wait_for(lambda m: m["type"] == "EnableLightsMessage" and not m["cast_shadow"])
        fine.wait_for(lambda m: m["type"] == "EnableLightsMessage")
        for _ in range(30):
            fine.read(0.2)
        assert (last_shadows(plain), last_shadows(fine)) == ([False], [True])


def test_each_viewer_plots_what_it_chose(running):
    with ViserClient(running) as one, ViserClient(running) as other:
        wait_until(lambda: running.viewers == 2)
        one.set("last 20 s", "measured bend [°]")

        def plots(message, count):
            return message["type"] == "GuiUplotMessage" and len(message["props"]["series"]) == 1 + count

        place = one.wait_for(lambda m: plots(m, 12))["container_uuid"]
        assert one.wait_for(lambda m: plots(m, 6))["container_uuid"] == place
        other.wait_for(lambda m: plots(m, 12))
        other.drain()
        assert not any(plots(message, 6) for message in other.messages)


@pytest.mark.parametrize(("width", "folded"), [(800, True), (1600, False)])
def test_in_a_narrow_frame_the_panel_starts_folded(running, width, folded):
    with ViserClient(running, width=width) as client:
        client.wait_for(lambda m: m.get("props", {}).get("label") == "camera")
        collapsed = [m["collapsed"] for m in client.messages if m["type"] == "GuiSetPanelCollapsedMessage"]
        assert (True in collapsed) is folded


def test_a_viewer_that_leaves_is_forgotten(running):
    with ViserClient(running):
        wait_until(lambda: running.viewers == 1)
    wait_until(lambda: running.viewers == 0)
    assert not running.errors
