"""The twin as it really is, in the 3D view: where its vertebrae are, which the console's own estimate does not know.

A vertebra can be dragged with the mouse: that pushes on the twin, with a force that grows with the distance. It is for the
twin only. It travels on a key that no hardware listens to, and moves no drive.
"""

import math
import threading

import msgspec
import numpy as np
import viser

from app.console import appearance
from app.console.meshes import Floats, lathe, quaternions, single
from app.twin_pushes import strongest_push_N
from cobra.description import RobotDescription
from cobra.messages import Push

NODE = "/twin"
FULL_SHARE = 0.25
"""Of the active length: dragged so far it is pushed with full force."""
REPEAT_S = 0.1
ARROW_SHARE = 0.2
"""Of the active length: the arrow of the strongest push."""


class SeenTruth(msgspec.Struct):
    """What the view takes of the twin's truth."""

    vertebrae: list[tuple[float, float, float]]


class TwinView:
    """The twin's vertebrae, draggable. `update` from the viewer's thread; drags come on viser's."""

    def __init__(self, server: viser.ViserServer, description: RobotDescription, radius_m: float) -> None:
        self._server = server
        self._length = description.active_length_m
        self._strongest = strongest_push_N(description)
        self._radius = radius_m
        self._lock = threading.Lock()
        self._pushes: dict[int, tuple[int, Floats]] = {}
        """By client: the vertebra that it drags, and the force [N]."""
        self._sent: set[int] = set()
        self._sent_s = -math.inf
        self._places: Floats | None = None

    @property
    def built(self) -> bool:
        """Whether it is in the scene, where each client shows or hides it."""
        return self._places is not None

    @property
    def pushes(self) -> dict[int, Floats]:
        """Force on each vertebra that is dragged now [N]."""
        with self._lock:
            out: dict[int, Floats] = {}
            for vertebra, force in self._pushes.values():
                out[vertebra] = out.get(vertebra, np.zeros(3)) + force
            return {vertebra: _limited(force, self._strongest) for vertebra, force in out.items()}

    def update(self, data: bytes, now_s: float) -> list[Push]:
        """Draw the twin where its truth (MessagePack) has it; gives the pushes to be sent now.

        Raises:
            msgspec.MsgspecError: `data` is no truth.
        """
        places = np.array(msgspec.msgpack.decode(data, type=SeenTruth).vertebrae, dtype=float).reshape(-1, 3)
        if self._places is None and len(places):
            self._build(places)
        self._places = places
        if not len(places):
            return []
        with self._server.atomic():
            chain = np.vstack([np.zeros(3), places]) if places[0, 2] > 0.0 else places
            if len(chain) == len(self._line.points) + 1:
                self._line.points = single(np.stack([chain[:-1], chain[1:]], axis=1))
            self._guiders.batched_positions = single(places)
            self._guiders.batched_wxyzs = single(_along(chain, len(places)))
            pushes = self.pushes
            self._arrows.visible = bool(pushes)
            if pushes:
                self._arrows.points = single(self._arrow_points(places, pushes))
        return self._to_send(pushes, now_s)

    def _build(self, places: Floats) -> None:
        scene, count = self._server.scene, len(places)
        scene.add_frame(NODE, show_axes=False)
        thickness = 0.2 * self._radius
        ring = ((-0.5, 0.9), (-0.5, 1.0), (0.5, 1.0), (0.5, 0.9), (-0.5, 0.9))
        vertices, faces = lathe(tuple((z * thickness, 1.12 * r * self._radius) for z, r in ring), 32)
        self._guiders = scene.add_batched_meshes_simple(
            f"{NODE}/vertebrae",
            vertices,
            faces,
            batched_wxyzs=np.tile([1.0, 0.0, 0.0, 0.0], (count, 1)),
            batched_positions=places,
            batched_colors=appearance.linear(appearance.TWIN),
            lod="off",
        )
        chain = np.vstack([np.zeros(3), places]) if places[0, 2] > 0.0 else places
        segments = np.stack([chain[:-1], chain[1:]], axis=1)
        self._line = scene.add_line_segments(
            f"{NODE}/axis", segments, appearance.linear(appearance.TWIN), thickness=0.06 * self._radius
        )
        self._arrows = scene.add_line_segments(
            f"{NODE}/push",
            np.zeros((count, 2, 3)),
            appearance.linear(appearance.PUSH),
            thickness=0.12 * self._radius,
            visible=False,
        )

        @self._guiders.on_drag("left")
        async def _(event: viser.SceneNodeDragEvent[viser.BatchedMeshHandle]) -> None:
            self.drag(event.client_id, event.instance_index, event.end_position, event.phase == "end")

    def drag(self, client: int, vertebra: int | None, to: tuple[float, float, float], over: bool) -> None:
        """A client drags a vertebra to a place [m], or lets it go."""
        with self._lock:
            if over or vertebra is None or self._places is None or not 0 <= vertebra < len(self._places):
                self._pushes.pop(client, None)
                return
            pull = (
                (np.asarray(to, dtype=float) - self._places[vertebra]) * self._strongest / (FULL_SHARE * self._length)
            )
            if np.isfinite(pull).all():
                self._pushes[client] = (vertebra, _limited(pull, self._strongest))

    def forget(self, client: int) -> None:
        """A client has left, and with it its hand."""
        with self._lock:
            self._pushes.pop(client, None)

    def _to_send(self, pushes: dict[int, Floats], now_s: float) -> list[Push]:
        over = self._sent - set(pushes)
        if not over and now_s - self._sent_s < REPEAT_S:
            return []
        self._sent, self._sent_s = set(pushes), now_s
        return [
            *(Push(vertebra=vertebra) for vertebra in sorted(over)),
            *(Push(vertebra=vertebra, force_N=tuple(force.tolist())) for vertebra, force in pushes.items()),
        ]

    def _arrow_points(self, places: Floats, pushes: dict[int, Floats]) -> Floats:
        points = np.zeros((len(places), 2, 3))
        points[:] = places[next(iter(pushes))]
        for vertebra, force in pushes.items():
            points[vertebra, 0] = places[vertebra]
            points[vertebra, 1] = places[vertebra] + ARROW_SHARE * self._length * force / self._strongest
        return points


def _limited(force: Floats, strongest: float) -> Floats:
    size = float(np.linalg.norm(force))
    return force if size <= strongest else force * (strongest / size)


def _along(chain: Floats, count: int) -> Floats:
    """Quaternions (count, 4) of rings that stand across the chain at its last `count` points."""
    tangents = np.gradient(chain, axis=0)[-count:]
    z = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    x = np.cross(np.broadcast_to([0.0, 1.0, 0.0], z.shape), z)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-9)
    return quaternions(np.stack([x, np.cross(z, x), z], axis=2))
