"""Saved poses of a robot: named configurations, kept on disk by the robot process, written whole or not at all."""

import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration

Floats = NDArray[np.float64]

MOST = 50
"""Poses a robot may have: a list that a person can still find one in."""
NAME = re.compile(r"^[^\W_][\w .-]{0,39}$")
NAME_WORDS = "up to 40 letters, digits, spaces, dots and dashes, beginning with a letter or a digit"


class _Saved(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file: what the entries of q are, so that another robot of the same name is noticed, and the poses."""

    robot: str
    entries: tuple[str, ...]
    poses: dict[str, tuple[float, ...]]


class PoseBook(Mapping[str, Floats]):
    """The saved poses of one robot, by name, in the order in which they were saved.

    `save` and `delete` change the book at once and put the file on its way; a thread of its own writes it, so that no
    slow disk delays a tick. What goes wrong there is told to `complain`.
    """

    def __init__(
        self,
        description: RobotDescription,
        path: Path | None = None,
        complain: Callable[[str], None] = lambda text: None,
    ) -> None:
        """`path` is the file; None keeps the poses in memory only."""
        self._robot = description.name
        self._layout = Configuration(description)
        self._path = path
        self._poses: dict[str, Floats] = {}
        self._unwritten: _Saved | None = None
        self._changed = threading.Condition()
        self._done = False
        self._writer: threading.Thread | None = None
        self.complain = complain

    def __getitem__(self, name: str) -> Floats:
        return self._poses[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._poses)

    def __len__(self) -> int:
        return len(self._poses)

    def start(self) -> None:
        """Read the file and be ready to write it. A file that cannot be used is left alone, and told of."""
        if self._path is None:
            return
        try:
            self._poses = self._read(self._path.read_bytes())
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            self._path, wrong = None, self._path
            self.complain(
                f"saved poses in {wrong} cannot be used ({error}); new ones are not kept. Mend or move the file."
            )
            return
        self._writer = threading.Thread(target=self._write_changes, name="poses", daemon=True)
        self._writer.start()

    def stop(self) -> None:
        """Write what is on its way."""
        with self._changed:
            self._done = True
            self._changed.notify()
        if self._writer is not None:
            self._writer.join(5.0)

    def save(self, name: str, q: Floats) -> str:
        """Keep q (size,) under a name, in place of what had it; returns why it is refused, or an empty string."""
        if not NAME.match(name):
            return f"a pose cannot be named {name!r}: {NAME_WORDS}"
        if name not in self._poses and len(self._poses) >= MOST:
            return f"there are {MOST} poses already: delete one first"
        self._poses = {**self._poses, name: q.copy()}
        self._keep()
        return ""

    def delete(self, name: str) -> str:
        """Forget a pose; returns why it is refused, or an empty string."""
        if name not in self._poses:
            return f"there is no pose {name!r}"
        self._poses = {other: q for other, q in self._poses.items() if other != name}
        self._keep()
        return ""

    def _read(self, data: bytes) -> dict[str, Floats]:
        """The poses in a file's bytes.

        Raises:
            ValueError: they are not this robot's poses.
        """
        saved = msgspec.json.decode(data, type=_Saved)
        if saved.entries != self._layout.names:
            raise ValueError(f"they are of a robot with {', '.join(saved.entries)}")
        poses = {name: np.array(q, dtype=float) for name, q in saved.poses.items()}
        for name, q in poses.items():
            if q.shape != (self._layout.size,) or not np.isfinite(q).all():
                raise ValueError(f"pose {name!r} has not {self._layout.size} finite numbers")
        return poses

    def _keep(self) -> None:
        with self._changed:
            poses = {name: tuple(q.tolist()) for name, q in self._poses.items()}
            self._unwritten = _Saved(robot=self._robot, entries=self._layout.names, poses=poses)
            self._changed.notify()

    def _write_changes(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._unwritten is not None or self._done)
                saved, self._unwritten = self._unwritten, None
            if saved is None:
                return
            try:
                self._write(saved)
            except OSError as error:
                self.complain(f"the saved poses could not be written ({error}): they are lost when this process ends")

    def _write(self, saved: _Saved) -> None:
        """Atomic: the old file stays until the new one is on the disk."""
        assert self._path is not None
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        fresh = self._path.with_suffix(f".{os.getpid()}")
        with fresh.open("wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(saved)))
            file.flush()
            os.fsync(file.fileno())
        fresh.replace(self._path)
