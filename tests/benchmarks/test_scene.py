"""What the 3D view costs: Python time a frame against the plain way, and bytes a second to each viewer."""

import threading
import time

import numpy as np
import pytest
import viser

from app.console.scene import Scene
from app.console.viewer import Viewer
from tests.app.console.scene_fakes import COBRA, ViserClient, state_of, wait_until

pytestmark = pytest.mark.benchmark

FRAMES = 300
SECONDS = 5.0


def frame_ms(draw, states):
    times = []
    for state in states:
        start = time.perf_counter()
        draw(state)
        times.append(1e3 * (time.perf_counter() - start))
    return np.percentile(times, [50, 99])


def test_a_frame_against_one_that_builds_its_nodes_anew(capsys):
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    counter = server._websock_server._broadcast_buffer
    scene = Scene(server, COBRA)
    scene.start()
    states = [state_of(t=i / 30.0) for i in range(FRAMES)]

    def anew(state):
        pose = scene.body.pose(np.array(state.measured))
        server.scene.add_mesh_simple("/plain/tube", pose.tube, scene.body.tube_faces)
        for i, (position, wxyz) in enumerate(zip(pose.vertebrae, pose.vertebrae_wxyz, strict=True)):
            server.scene.add_frame(f"/plain/{i}", position=position, wxyz=wxyz)
        server.scene.add_line_segments("/plain/tendons", pose.tendons, (1, 2, 3))
        server.scene.add_mesh_simple(
            "/plain/ghost", scene.body.tube(np.array(state.commanded), 1.0), scene.body.tube_faces
        )

    kinematics = frame_ms(lambda state: scene.body.pose(np.array(state.measured)), states)
    before = counter.message_counter
    ours = frame_ms(scene.update, states)
    own_messages = (counter.message_counter - before) / FRAMES
    before = counter.message_counter
    plain = frame_ms(anew, states[:60])
    plain_messages = (counter.message_counter - before) / 60
    server.stop()
    with capsys.disabled():
        print(f"\n3D view, one frame of a moving robot ({len(scene.body.vertebra_sizes)} vertebrae, 12 tendons)")
        print(f"  shape alone     p50 {kinematics[0]:6.2f} ms  p99 {kinematics[1]:6.2f} ms")
        print(f"  update          p50 {ours[0]:6.2f} ms  p99 {ours[1]:6.2f} ms   {own_messages:6.1f} messages")
        print(f"  nodes anew      p50 {plain[0]:6.2f} ms  p99 {plain[1]:6.2f} ms   {plain_messages:6.1f} messages")
        print(f"  {plain[0] / ours[0]:.1f} times the time, {plain_messages / own_messages:.0f} times the messages")
    assert own_messages < plain_messages


@pytest.mark.parametrize("clients", [1, 5])
def test_bytes_a_second_to_each_viewer(clients, capsys):
    start = time.monotonic()
    viewer = Viewer(COBRA, lambda: state_of(t=time.monotonic() - start))
    viewer.start()
    sinks = [ViserClient(viewer) for _ in range(clients)]
    wait_until(lambda: viewer.viewers == clients)
    for sink in sinks:
        for _ in range(20):
            sink.read(0.2)
        sink.messages.clear()
        sink.received_bytes = 0
    ends = time.monotonic() + SECONDS
    cpu, wall = time.process_time(), time.monotonic()

    def swallow(sink):
        while time.monotonic() < ends:
            sink.read(0.05)

    threads = [threading.Thread(target=swallow, args=(sink,)) for sink in sinks]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    share = (time.process_time() - cpu) / (time.monotonic() - wall)
    rate, errors = viewer.frame_rate, dict(viewer.errors)
    kinds = [message["type"] for message in sinks[0].messages]
    scene = sum(kind in ("SceneNodeUpdateMessage", "SetSceneNodeVisibilityMessage") for kind in kinds)
    for sink in sinks:
        sink.close()
    viewer.stop()
    each = [sink.received_bytes / SECONDS / 1e3 for sink in sinks]
    with capsys.disabled():
        print(f"\n3D view with panels and plot, {clients} viewer(s), {rate:.1f} frames/s, errors {errors}")
        print(f"  {np.mean(each):7.0f} kB/s a viewer; messages a second: {scene / SECONDS:.0f} scene,")
        print(
            f"  {(len(kinds) - scene) / SECONDS:.0f} panels; {100 * share:.0f} % of a core with the test's own reading"
        )
    assert not errors
