"""The channels of a recording: topic, message type and JSON Schema, all from the message types themselves.

Everything is JSON in an MCAP container, so that a file can be read in ten years without this program. A number that is
not known (NaN) is null, as is what there is none of. Times are nanoseconds of the wall clock: the robot's own stamps, moved as a whole.
"""

from collections.abc import Mapping
from functools import cache
from typing import Any, Final, Literal, NamedTuple, TypeVar

import msgspec
from msgspec import inspect, json

from app.console.inputs import Button
from cobra.description import RobotDescription
from cobra.messages import Answered, Event, Judged, Message, RobotState

FORMAT: Final = 1
"""Version of the layout below. A reader shows what it understands of a newer one and says so."""
PROFILE: Final = "cobra-teleop"
"""Profile of the MCAP header."""
METADATA: Final = "cobra-teleop"
"""Name of the metadata record at the start: format, robot, title, started."""

STATE: Final = "/state"
COMMAND: Final = "/command"
REQUEST: Final = "/request"
EVENT: Final = "/event"
INPUT: Final = "/input"
RECORDER: Final = "/recorder"

DESCRIPTION: Final = "description.toml"
VERSIONS: Final = "versions.json"
SETTINGS: Final = "settings.json"
CALIBRATION: Final = "calibration.json"
DIGEST: Final = "digest.json"

M = TypeVar("M", bound=msgspec.Struct)


class Input(Message, frozen=True, kw_only=True):
    """One reading of whatever drove, before dead zone and expo, and what was chosen with it."""

    stamp: float
    """When it was sent [s, the console's clock]."""
    source: str = ""
    """"pad", the name of a page, or empty while nobody drives."""
    left: tuple[float, float] = (0.0, 0.0)
    right: tuple[float, float] = (0.0, 0.0)
    left_trigger: float = 0.0
    right_trigger: float = 0.0
    buttons: tuple[Button, ...] = ()
    section: int = 0
    """Index of the chosen section."""
    level: int = 0
    """Index of the chosen speed level."""
    mode: str = "section"
    frame: str = ""
    """In which view the sticks were meant."""


class RecorderState(Message, frozen=True, kw_only=True):
    """The recorder about itself, once a second."""

    written: int = 0
    """Messages in the file."""
    size_bytes: int = 0
    """Size of the file."""
    dropped: int = 0
    """Messages lost because the disk was slow or full."""
    missed: int = 0
    """Ticks of the robot whose states did not reach the recorder."""
    unreadable: int = 0
    """Messages that could not be decoded."""
    problem: str = ""
    """What is wrong with the disk, in words; empty when nothing is."""


TYPES: Final[dict[str, type[Message]]] = {
    STATE: RobotState,
    COMMAND: Judged,
    REQUEST: Answered,
    EVENT: Event,
    INPUT: Input,
    RECORDER: RecorderState,
}
"""Our own channels. Foxglove's are in `foxglove.py`."""

Level = Literal["info", "warning", "alarm", "marker"]


Kind = Literal["state", "history", "event", "heard", "calibration", "input"]
"""What is put in: the robot's keys as they came over the link, and our own readings."""


class Facts(NamedTuple):
    """What stands at the start of a recording, beside the messages."""

    robot: str
    description: RobotDescription | None
    attachments: Mapping[str, bytes]
    """description.toml, versions.json, settings.json: name → content."""


def encode(message: msgspec.Struct) -> bytes:
    """JSON; what is not finite becomes null."""
    return json.encode(message)


_decoders: dict[type, json.Decoder[Any]] = {}


def decode(data: bytes, kind: type[M]) -> M:
    """One message from its JSON; unknown fields of a newer version are passed over, null numbers are NaN again.

    Raises:
        msgspec.MsgspecError: it is no such message.
    """
    decoder = _decoders.get(kind) or _decoders.setdefault(kind, json.Decoder(kind))
    try:
        return decoder.decode(data)
    except msgspec.ValidationError:
        return msgspec.convert(_restored(json.decode(data), _shape(kind)), kind)


def schema(kind: type[msgspec.Struct]) -> bytes:
    """JSON Schema of a message type, in the plain form that Foxglove reads: no references, no unions.

    Raises:
        TypeError: the type holds something that has no such form.
    """
    whole = json.schema(kind)
    plain = _plain(whole, whole.get("$defs", {}))
    return json.encode({"$schema": "https://json-schema.org/draft/2020-12/schema", **plain})


@cache
def _shape(kind: type) -> inspect.Type:
    return inspect.type_info(kind)


def _restored(value: Any, shape: inspect.Type) -> Any:
    """A null is NaN where the type wants a number, and stays nothing where the type knows nothing."""
    match shape:
        case inspect.FloatType() if value is None:
            return float("nan")
        case inspect.StructType(fields=fields) if isinstance(value, dict):
            of = {field.encode_name: field.type for field in fields}
            return {name: _restored(entry, of[name]) for name, entry in value.items() if name in of}
        case inspect.VarTupleType(item_type=item) | inspect.ListType(item_type=item) if isinstance(value, list):
            return [_restored(entry, item) for entry in value]
        case inspect.TupleType(item_types=items) if isinstance(value, list):
            return [_restored(entry, item) for entry, item in zip(value, items, strict=False)]
        case inspect.DictType(value_type=item) if isinstance(value, dict):
            return {name: _restored(entry, item) for name, entry in value.items()}
        case inspect.UnionType(types=types) if value is not None:
            return next((_restored(value, one) for one in types if not isinstance(one, inspect.NoneType)), value)
    return value


def _plain(schema: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any]:
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"].rsplit("/", 1)[1]], definitions)
    facts: dict[str, Any] = {name: schema[name] for name in ("title", "description") if name in schema}
    if "anyOf" in schema:
        # What may be missing is simply not there: JSON Schema of its other alternative.
        alternatives = [entry for entry in schema["anyOf"] if entry.get("type") != "null"]
        if len(alternatives) == 1:
            return facts | _plain(alternatives[0], definitions)
        raise TypeError(f"no plain schema for a choice of {schema['anyOf']}")
    if "enum" in schema:
        numbers = all(isinstance(value, int) for value in schema["enum"])
        return facts | {"type": "integer" if numbers else "string", "enum": schema["enum"]}
    match schema.get("type"):
        case "object":
            properties = {name: _plain(entry, definitions) for name, entry in schema.get("properties", {}).items()}
            return facts | {"type": "object", "properties": properties}
        case "array":
            items = schema.get("items") or (schema.get("prefixItems") or [{"type": "number"}])[0]
            return facts | {"type": "array", "items": _plain(items, definitions)}
        case "boolean" | "string" | "number" | "integer" as kind:
            return facts | {"type": kind}
    raise TypeError(f"no plain schema for {schema}")
