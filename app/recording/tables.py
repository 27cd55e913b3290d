"""A channel of a recording as a table: one row a message, one column a number, in batches so that hours fit in memory.

Columns come from the message types, so that what they gain is exported by itself. Numbers in lists get a column each,
named after the drive or the entry of q; what has no fixed form (texts in lists, counters) is JSON in one column.
"""

from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter
from typing import Any, Final

import msgspec
import numpy as np
from msgspec import inspect
from numpy.typing import NDArray

from app.recording import channels
from app.recording.container import RecordingError
from app.recording.reader import Recording
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration

Column = NDArray[Any]
Table = dict[str, Column]
Values = Callable[[Any], Sequence[Any]]

ROWS: Final = 2000
"""Of a batch."""
NUMBERS: Final = (inspect.FloatType, inspect.IntType, inspect.BoolType)
PLAIN: Final = (*NUMBERS, inspect.StrType, inspect.LiteralType)


def channel_names(recording: Recording) -> tuple[str, ...]:
    """What can be exported of a recording: "state", "command", …"""
    return tuple(topic.removeprefix("/") for topic in channels.TYPES if topic in recording.topics)


def wanted_columns(recording: Recording, wanted: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Channel → beginnings of its columns, from names such as "event" or "state.drives.load"; all for none.

    Raises:
        RecordingError: the recording has no such channel, or the channel no such column.
    """
    known = channel_names(recording)
    out: dict[str, tuple[str, ...]] = {}
    for name in wanted or known:
        channel, _, column = name.partition(".")
        if channel not in known:
            raise RecordingError(f"{recording.path.name}: no channel {channel!r}; there are {', '.join(known)}")
        out[channel] = (*out.get(channel, ()), *((column,) if column else ("",)))
        names = _columns(recording, channel)[0]
        if column and not any(_under(entry, column) for entry in names):
            groups = sorted({entry.rsplit(".", 1)[0] for entry in names})
            raise RecordingError(f"{channel} has no column {column!r}; there are {', '.join(groups)}")
    return out


def batches(recording: Recording, channel: str, beginnings: Sequence[str] = ("",)) -> Iterator[Table]:
    """The rows of a channel, at most `ROWS` at a time; `time_s` [s from the start] and `time_ns` (wall clock) lead."""
    names, values = _columns(recording, channel)
    keep = [i for i, name in enumerate(names) if any(_under(name, beginning) for beginning in beginnings)]
    times: list[float] = []
    rows: list[list[Any]] = []
    for time_s, _, message in recording.messages((f"/{channel}",)):
        row = values(message)
        times.append(time_s)
        rows.append([row[i] for i in keep])
        if len(rows) == ROWS:
            yield _table(recording, [names[i] for i in keep], times, rows)
            times, rows = [], []
    if rows:
        yield _table(recording, [names[i] for i in keep], times, rows)


def _table(recording: Recording, names: Sequence[str], times: list[float], rows: list[list[Any]]) -> Table:
    time_s = np.array(times)
    table: Table = {"time_s": time_s, "time_ns": recording.start_ns + np.round(time_s * 1e9).astype(np.int64)}
    for name, column in zip(names, zip(*rows, strict=True), strict=True):
        table[name] = np.array(column)
    return table


def _under(name: str, beginning: str) -> bool:
    return not beginning or name == beginning or name.startswith(f"{beginning}.")


def _columns(recording: Recording, channel: str) -> tuple[list[str], Values]:
    kind = channels.TYPES[f"/{channel}"]
    lengths = _lengths(recording.description)
    names: list[str] = []
    getters: list[Callable[[Any], Sequence[Any]]] = []
    _walk(inspect.type_info(kind), "", lengths, names, getters)
    return names, lambda message: [value for getter in getters for value in getter(message)]


def _walk(
    shape: inspect.Type,
    path: str,
    lengths: dict[str, tuple[str, ...]],
    names: list[str],
    getters: list[Callable[[Any], Sequence[Any]]],
) -> None:
    if isinstance(shape, inspect.StructType):
        for field in shape.fields:
            _walk(field.type, f"{path}.{field.name}".lstrip("."), lengths, names, getters)
        return
    get = attrgetter(path)
    labels = lengths.get(path.rsplit(".", 1)[-1] if path.startswith("drives.") else path)
    if isinstance(shape, PLAIN):
        names.append(path)
        getters.append(lambda message: (get(message),))
    elif isinstance(shape, inspect.VarTupleType) and isinstance(shape.item_type, NUMBERS) and labels:
        names += [f"{path}.{label}" for label in labels]
        n = len(labels)
        getters.append(lambda message: (*get(message), *(float("nan"),) * n)[:n])
    elif isinstance(shape, inspect.TupleType) and all(isinstance(item, NUMBERS) for item in shape.item_types):
        ends = ("x", "y", "z") if len(shape.item_types) <= 3 else tuple(map(str, range(len(shape.item_types))))
        names += [f"{path}.{label}" for label in ends[: len(shape.item_types)]]
        getters.append(lambda message: tuple(get(message)))
    else:
        names.append(path)
        getters.append(lambda message: (msgspec.json.encode(get(message)).decode(),))


def _lengths(description: RobotDescription | None) -> dict[str, tuple[str, ...]]:
    """Names of the entries of lists that have one for each entry of q or each drive."""
    if description is None:
        return {}
    q = tuple(name.replace(" ", "_") for name in Configuration(description).names)
    drives = tuple(drive.name for drive in description.drives)
    per_drive = ("travel", "setpoint", "velocity", "load", "temperature", "voltage", "age", "valid")
    return {"measured": q, "commanded": q, **dict.fromkeys(per_drive, drives)}
