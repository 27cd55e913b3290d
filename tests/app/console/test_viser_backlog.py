"""A viewer joins at once after a week of updates, and gets the same scene as from viser's own sender."""

import pytest
import viser
from viser.infra._async_message_buffer import AsyncMessageBuffer

from app.console.viewer import Viewer
from tests.app.console.scene_fakes import COBRA, ViserClient, state_of

A_WEEK = 7 * 24 * 3600 * 30 * 8
"""Messages of a week at 30 frames a second."""


@pytest.fixture
def viewer():
    viewer = Viewer(COBRA, state_of)
    viewer.start()
    yield viewer
    viewer.stop()


def later(viewer, messages):
    """As if so many messages had been sent, each replaced by a newer one since."""
    buffer = viewer._server._websock_server._broadcast_buffer
    with buffer.buffer_lock:
        buffer.message_counter += messages


def scene_of(client):
    """Names of the nodes that a client was sent, once it was told that this is all there is."""
    client.wait_for(lambda m: m["type"] == "ReplayDoneMessage")
    done = next(i for i, m in enumerate(client.messages) if m["type"] == "ReplayDoneMessage")
    return {m["name"] for m in client.messages[:done] if "name" in m and "props" in m}


def test_after_a_week_a_new_viewer_gets_the_whole_scene(viewer):
    with ViserClient(viewer) as first:
        before = scene_of(first)
    later(viewer, A_WEEK)
    with ViserClient(viewer) as late:
        assert scene_of(late) == before >= {"/tube", "/tendons", "/vertebrae", "/floor", "/port/plate"}
        # And what comes from now on arrives as well.
        viewer._server.scene.add_frame("/new")
        late.wait_for(lambda m: m.get("name") == "/new")


def test_who_joined_before_the_week_goes_on_hearing(viewer):
    with ViserClient(viewer) as patient:
        scene_of(patient)
        later(viewer, A_WEEK)
        viewer._server.scene.add_frame("/new")
        patient.wait_for(lambda m: m.get("name") == "/new")


def test_every_message_comes_once_and_in_its_order_however_many_numbers_are_missing():
    viewer = Viewer(COBRA, state_of)
    viewer.open()  # and draw nothing
    buffer = viewer._server._websock_server._broadcast_buffer
    for gap in (0, 3, A_WEEK):
        later(viewer, gap)
        viewer._server.scene.add_frame(f"/after {gap}")
        last = buffer.message_counter - 1
        got, cursor = [], -1
        while cursor < last:
            window, cursor = buffer.after(cursor, last)
            assert len(window) <= buffer.max_window_size
            got += window
        assert got == list(buffer.message_from_id.values())
    viewer.stop()


def test_viser_still_has_the_sender_that_is_replaced_here():
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        assert type(server._websock_server._broadcast_buffer) is AsyncMessageBuffer
        assert hasattr(AsyncMessageBuffer, "_window_loop")
    finally:
        server.stop()
