"""For the 3D view's tests: states of moving robots, robots of other kinds, and a client that speaks viser's protocol."""

import math
import time
from collections.abc import Callable
from typing import Any, Self

import msgspec
import numpy as np
import viser
import zstandard
from websockets import Subprotocol
from websockets.sync.client import connect

from app.console.viewer import Viewer
from app.console.viewer_proxy import SECRET_HEADER
from cobra.description import Elongation, RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.loading import load_description
from cobra.messages import Drives, RobotState, Timing

COBRA = load_description("cobra")


def bend_of(description: RobotDescription, t: float) -> tuple[float, ...]:
    """A configuration that moves smoothly with time, within the limits."""
    configuration = Configuration(description)
    q = configuration.rest().copy()
    for i, bend in enumerate(configuration.bends):
        q[bend] = 0.8 * math.sin(t + 1.3 * i), 0.7 * math.cos(0.8 * t + 1.9 * i)
    if description.twist:
        q[0] = 0.3 * math.sin(0.4 * t)
    return tuple(q.tolist())


def drives_of(description: RobotDescription, **changes: tuple[Any, ...]) -> Drives:
    count = len(description.drives)
    values: dict[str, tuple[Any, ...]] = {
        "travel": (0.001,) * count,
        "setpoint": (0.0012,) * count,
        "velocity": (0.0,) * count,
        "load": tuple(5.0 + i for i in range(count)),
        "temperature": (31.0,) * count,
        "voltage": (24.1,) * count,
        "age": (0.004,) * count,
        "valid": (True,) * count,
        "fault": ("",) * count,
    }
    return Drives(**(values | changes))


def state_of(description: RobotDescription = COBRA, t: float = 0.0, **changes: Any) -> RobotState:
    """A driving robot at time `t` whose command runs ahead of its measured shape."""
    values: dict[str, Any] = {
        "robot": description.name,
        "stamp": 1000.0 + t,
        "tick": round(100 * t),
        "phase": "driving",
        "homed": True,
        "measured": bend_of(description, t),
        "commanded": bend_of(description, t + 0.2),
        "drives": drives_of(description, load=tuple(8.0 + 7.0 * math.sin(t + i) for i in range(14))),
        "timing": Timing(rate_Hz=100.0, period_p50=0.01, period_p99=0.0101, period_max=0.012, compute_p99=0.0012),
    }
    return RobotState(**(values | changes))


def hanging_the_other_way() -> RobotDescription:
    """COBRA entering sideways, gravity down the y axis."""
    backbone = msgspec.structs.replace(COBRA.backbone, gravity_m_s2=(0.0, 9.81, 0.0))
    return msgspec.structs.replace(COBRA, backbone=backbone)


def without_tendons() -> RobotDescription:
    """Twist and feed alone: a passive borescope."""
    sections = tuple(msgspec.structs.replace(section, routing=None) for section in COBRA.sections)
    drives = tuple(drive for drive in COBRA.drives if drive.moves != "tendon")
    return msgspec.structs.replace(COBRA, sections=sections, drives=drives, tendon=None)


def elongating() -> RobotDescription:
    """A robot whose middle section can change its length."""
    stretch = Elongation(
        range_m=(0.08, 0.12),
        stiffness_N_m=5136.0,
        rate_m_s=0.02,
        acceleration_m_s2=0.1,
        locked_length_m=0.08,
        unlocked_length_m=0.084,
    )
    base, middle, tip = COBRA.sections
    return msgspec.structs.replace(COBRA, sections=(base, msgspec.structs.replace(middle, elongation=stretch), tip))


class ViserClient:
    """A browser's side of viser's websocket: takes part as a viewer, and remembers what it was sent."""

    def __init__(self, viewer: Viewer, width: int = 1600, inbox: int = 1000, **headers: str) -> None:
        """`inbox`: windows of messages that wait here unread before the server has to."""
        self._socket = connect(
            f"ws://127.0.0.1:{viewer.port}",
            additional_headers={SECRET_HEADER: viewer.secret, **headers},
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            compression=None,
            max_size=None,
            max_queue=inbox,
            close_timeout=0.1,
        )
        self.messages: list[dict[str, Any]] = []
        self.received_bytes = 0
        self.send(
            "ViewerCameraMessage",
            wxyz=(1.0, 0.0, 0.0, 0.0),
            position=(1.0, 1.0, 1.0),
            fov=0.7,
            near=0.01,
            far=6.0,
            image_height=900,
            image_width=width,
            look_at=(0.0, 0.0, 0.0),
            up_direction=(0.0, 0.0, -1.0),
        )

    def send(self, kind: str, **fields: Any) -> None:
        self._socket.send(msgspec.msgpack.encode({"type": kind, **fields}))

    def set(self, label: str, value: Any) -> None:
        """Work the control with this label, as a browser does."""
        control = self.wait_for(lambda m: m.get("props", {}).get("label") == label)
        self.send("GuiUpdateMessage", uuid=control["uuid"], updates={"value": value})

    def read(self, timeout_s: float) -> bool:
        """Take one window of messages; False when none came in time."""
        try:
            frame = self._socket.recv(timeout=timeout_s)
        except TimeoutError:
            return False
        assert isinstance(frame, bytes)
        self.received_bytes += len(frame)
        size = int.from_bytes(frame[:8], "little")
        packed = frame[16 : 16 + int.from_bytes(frame[8:16], "little")]
        window = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(packed, max_output_size=size))
        self.messages += window["messages"]
        return True

    def wait_for(self, matches: Callable[[dict[str, Any]], bool], timeout_s: float = 10.0) -> dict[str, Any]:
        """The first message, already here or to come, that matches."""
        deadline, seen = time.monotonic() + timeout_s, 0
        while True:
            for message in self.messages[seen:]:
                if matches(message):
                    return message
            seen = len(self.messages)
            remaining = deadline - time.monotonic()
            assert remaining > 0.0, f"no such message among {sorted({m['type'] for m in self.messages})}"
            self.read(remaining)

    def drain(self) -> None:
        """Take everything that is on its way, and forget all of it."""
        while self.read(0.1):
            pass
        self.messages.clear()

    def close(self) -> None:
        self._socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def wait_until(condition: Callable[[], bool], timeout_s: float = 10.0) -> None:
    """Wait for something that another thread does."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "it did not happen in time"
        time.sleep(0.005)


def rotation_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The smallest rotation (3, 3) that turns the unit vector a to b: what a cross-section does that does not twist."""
    axis, cosine = np.cross(a, b), float(a @ b)
    skew = np.array([[0.0, -axis[2], axis[1]], [axis[2], 0.0, -axis[0]], [-axis[1], axis[0], 0.0]])
    return np.eye(3) + skew + skew @ skew / (1.0 + cosine)
