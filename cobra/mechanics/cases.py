"""Load cases: TOML files that say what acts on SRC-Bot, and when. Whatever is wrong with one is told in one line."""

import math
import re
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from msgspec import Meta

from cobra.errors import OperatorError
from cobra.mechanics.chain import MOUNTINGS, Positive, SrcBotParameters
from cobra.mechanics.dynamics import RECORD_S, Chain
from cobra.mechanics.inverse import BalanceError, Posture, inverse_statics
from cobra.mechanics.schedule import Cables, CommandKind, Load, Schedule

Mounting = Literal["hanging", "upright", "horizontal", "weightless"]
Quantity = Literal["x", "y", "z", "position", "angle"]
Times = Annotated[tuple[Annotated[float, Meta(ge=0)], ...], Meta(min_length=1)]
Index = Annotated[int, Meta(ge=1)]
MOST_ROWS = 1_000_000


class CaseError(OperatorError):
    """A load case that cannot be used. The message names file, key, value and what is allowed."""


class _Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every table of a case: an unknown key is an error, not a silent default."""


class Start(_Part, frozen=True, kw_only=True):
    """The posture in which the case begins, in balance; the cables go on to keep the forces or lengths that hold it."""

    bend_deg: float
    """Sum of the chambers' bends."""
    direction_deg: float = 0.0
    length_m: Positive | None = None
    """Sum of the chambers' lengths; without it no cable pulls more than bending takes."""
    hold: CommandKind = "forces"


class CableCommand(_Part, frozen=True, kw_only=True):
    """What one motor does from given times on: hold each value until the next time, or join them by lines."""

    cable: Index
    time_s: Times
    force_N: tuple[float, ...] | None = None
    length_m: tuple[float, ...] | None = None
    interpolation: Literal["step", "linear"] = "step"


class LoadCommand(_Part, frozen=True, kw_only=True):
    """A force on one guider from given times on, in the axes of the base."""

    guider: Index
    """1 (base) … n (top)."""
    time_s: Times
    force_N: tuple[tuple[float, float, float], ...]
    interpolation: Literal["step", "linear"] = "step"


class Reported(_Part, frozen=True, kw_only=True):
    """An error band that the paper reports between its own model and the robot (mm, or degrees for angles)."""

    quantity: Quantity
    low: float | None = None
    high: float | None = None
    guiders: tuple[Index, ...] = ()
    """Empty: all."""
    note: str = ""


class CaseFile(_Part, frozen=True, kw_only=True):
    """A load case as it stands in its file."""

    title: str
    note: str = ""
    duration_s: Positive
    record_s: Positive = RECORD_S
    mounting: Mounting | tuple[float, float, float] = "hanging"
    """By name, or gravity in the frame of the base [m/s²]."""
    robot: SrcBotParameters = SrcBotParameters()
    start: Start | None = None
    cables: tuple[CableCommand, ...] = ()
    loads: tuple[LoadCommand, ...] = ()
    reported: tuple[Reported, ...] = ()


@dataclass(frozen=True)
class Case:
    """A load case, ready to run."""

    name: str
    text: str
    """As it stands in its file."""
    file: CaseFile
    parameters: SrcBotParameters
    cables: Cables
    loads: tuple[Load, ...]
    posture: Posture | None

    def chain(self) -> Chain:
        """A fresh robot in the case's first posture."""
        if self.posture is None:
            return Chain(self.parameters)
        return Chain(self.parameters, self.posture.q, self.posture.tensions_N)

    @property
    def load_time_s(self) -> float | None:
        """When the first external force begins to act [s]; None without one."""
        return min((float(load.force.time_s[0]) for load in self.loads), default=None)


def case_names() -> tuple[str, ...]:
    """The cases that come with the program: those of the SRC-Bot paper."""
    folder = resources.files("cobra.mechanics") / "cases"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_case(name_or_path: str | Path) -> Case:
    """Load a case that comes with the program by its name, or a TOML file by its path.

    Raises:
        CaseError: the file is missing or not TOML, a key is unknown, missing, of the wrong type or impossible, or the first
            posture cannot be held.
    """
    text, label = _read(name_or_path)
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CaseError(f"{label}: not valid TOML: {error}") from None
    try:
        file = msgspec.convert(tree, CaseFile)
    except msgspec.ValidationError as error:
        raise CaseError(_explain(label, tree, str(error))) from None
    for complaint in _contradictions(file, tree):
        raise CaseError(f"{label}: {complaint}")
    gravity = MOUNTINGS[file.mounting] if isinstance(file.mounting, str) else file.mounting
    parameters = msgspec.structs.replace(file.robot, gravity_m_s2=gravity)
    posture = _posture(label, parameters, file.start)
    return Case(
        Path(label).stem,
        text,
        file,
        parameters,
        _cables(parameters, file, posture),
        tuple(map(_load, file.loads)),
        posture,
    )


def _read(name_or_path: str | Path) -> tuple[str, str]:
    if isinstance(name_or_path, str) and name_or_path in case_names():
        return (resources.files("cobra.mechanics") / "cases" / f"{name_or_path}.toml").read_text("utf-8"), (
            f"{name_or_path}.toml"
        )
    try:
        return Path(name_or_path).read_text("utf-8"), str(name_or_path)
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise CaseError(
            f"{name_or_path}: cannot be read ({reason}); give a file or one of the cases {', '.join(case_names())}"
        ) from None


def _posture(label: str, parameters: SrcBotParameters, start: Start | None) -> Posture | None:
    if start is None:
        return None
    bend, direction = math.radians(start.bend_deg), math.radians(start.direction_deg)
    try:
        posture = inverse_statics(parameters, (bend * math.cos(direction), bend * math.sin(direction)), start.length_m)
    except BalanceError as error:
        raise CaseError(f"{label}: start: {error}") from None
    if not posture.reached:
        raise CaseError(f"{label}: start: this posture cannot be held: {'; '.join(posture.reasons)}")
    if not posture.stable:
        raise CaseError(f"{label}: start: this posture is unstable; the robot would fall out of it")
    return posture


def _cables(parameters: SrcBotParameters, file: CaseFile, posture: Posture | None) -> Cables:
    """A schedule for every cable; those without a command keep what they begin with."""
    kind = _kind(file)
    lengths = kind == "lengths"
    if posture is not None:
        q = posture.q
        first = q.sum(axis=0) @ parameters.cable_matrix.T if lengths else posture.tensions_N
        if lengths:
            # Wound in by its stretch, so that the cable carries what holds the posture.
            first = first - posture.tensions_N / parameters.cable_stiffness_N_m
    else:
        count = len(parameters.cable_azimuths_deg)
        first = np.full(count, parameters.segments * parameters.rest_length_m) if lengths else np.zeros(count)
    schedules = [Schedule.constant(value) for value in first]
    for command in file.cables:
        values = np.array(command.length_m if lengths else command.force_N, dtype=np.float64)
        schedules[command.cable - 1] = Schedule(
            np.array(command.time_s), values, command.interpolation == "linear", float(first[command.cable - 1])
        )
    return Cables(tuple(schedules), kind)


def _kind(file: CaseFile) -> CommandKind:
    if file.cables:
        return "lengths" if file.cables[0].length_m is not None else "forces"
    return file.start.hold if file.start is not None else "forces"


def _load(command: LoadCommand) -> Load:
    force = Schedule(np.array(command.time_s), np.array(command.force_N), command.interpolation == "linear")
    return Load(command.guider, force)


def _contradictions(file: CaseFile, tree: Any) -> Iterator[str]:
    """What the types cannot say."""
    for path, value in _numbers(tree, ""):
        if not math.isfinite(value):
            yield f"{path} = {value}: must be a finite number"
    if file.duration_s / file.record_s > MOST_ROWS:
        yield f"record_s = {file.record_s:g}: would record more than {MOST_ROWS} times; make it longer"
    robot = file.robot
    if "gravity_m_s2" in tree.get("robot", {}):
        yield "robot.gravity_m_s2: give it as mounting, by name or as [x, y, z]"
    if not robot.locked_length_m < robot.unlocked_length_m < robot.rest_length_m:
        yield (
            f"robot: locked_length_m = {robot.locked_length_m:g}, unlocked_length_m = {robot.unlocked_length_m:g} and "
            f"rest_length_m = {robot.rest_length_m:g} must increase in this order"
        )
    if np.linalg.matrix_rank(robot.cable_matrix) < 3 or _one_sided(robot.cable_azimuths_deg):
        yield f"robot.cable_azimuths_deg = {list(robot.cable_azimuths_deg)}: the cables must surround the backbone"
    yield from _wrong_cables(file)
    for i, load in enumerate(file.loads):
        key = f"loads[{i}]"
        if load.guider > robot.segments:
            yield f"{key}.guider = {load.guider}: there is no such guider; they are numbered 1 (base) to {robot.segments} (top)"
        yield from _wrong_times(key, load.time_s, len(load.force_N), "force_N", file.duration_s)
    for i, reported in enumerate(file.reported):
        for guider in reported.guiders:
            if guider > robot.segments:
                yield f"reported[{i}].guiders: there is no guider {guider}; there are {robot.segments}"


def _wrong_cables(file: CaseFile) -> Iterator[str]:
    seen: set[int] = set()
    count = len(file.robot.cable_azimuths_deg)
    for i, command in enumerate(file.cables):
        key = f"cables[{i}]"
        if command.cable > count:
            yield f"{key}.cable = {command.cable}: there is no such cable; they are numbered 1 to {count}"
        if command.cable in seen:
            yield f"{key}.cable = {command.cable}: has a command already; give all its times in one table"
        seen.add(command.cable)
        if (command.force_N is None) == (command.length_m is None):
            yield f"{key}: give either force_N or length_m"
            continue
        what, values = ("force_N", command.force_N) if command.force_N is not None else ("length_m", command.length_m)
        assert values is not None
        if what != ("length_m" if _kind(file) == "lengths" else "force_N"):
            yield f"{key}.{what}: all cables of a case are driven by force, or all by length"
        elif file.start is not None and file.start.hold != _kind(file):
            yield f"{key}.{what}: start.hold = {file.start.hold!r} drives the cables by {file.start.hold}"
        if min(values, default=0.0) < 0.0:
            yield f"{key}.{what} = {list(values)}: must not be negative; a cable can only pull"
        yield from _wrong_times(key, command.time_s, len(values), what, file.duration_s)


def _wrong_times(key: str, times: tuple[float, ...], count: int, what: str, duration_s: float) -> Iterator[str]:
    if len(times) != count:
        yield f"{key}.time_s: {len(times)} times for {count} values of {what}; there must be one for each"
    for i in range(1, len(times)):
        if times[i] <= times[i - 1]:
            yield f"{key}.time_s[{i}] = {times[i]:g}: follows {times[i - 1]:g}; times must increase"
    if times[-1] >= duration_s:
        yield f"{key}.time_s[{len(times) - 1}] = {times[-1]:g}: not before the end, duration_s = {duration_s:g}"


def _one_sided(azimuths_deg: tuple[float, ...]) -> bool:
    around = np.sort(np.asarray(azimuths_deg) % 360.0)
    return bool(np.diff(np.append(around, around[0] + 360.0)).max() >= 180.0 - 1e-9)


def _numbers(node: Any, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(node, dict):
        for key, child in node.items():
            yield from _numbers(child, f"{path}.{key}" if path else key)
    elif isinstance(node, list):
        for i, child in enumerate(node):
            yield from _numbers(child, f"{path}[{i}]")
    elif isinstance(node, int | float) and not isinstance(node, bool):
        yield path, float(node)


_TABLES: dict[str, type[msgspec.Struct]] = {
    "": CaseFile, "robot": SrcBotParameters, "start": Start, "cables": CableCommand, "loads": LoadCommand,
    "reported": Reported,
}  # fmt: skip


def _explain(label: str, tree: Any, message: str) -> str:
    """Turn msgspec's message into file, key, value and what is allowed."""
    found = re.search(r" - at `\$\.?(.*)`$", message)
    path = found.group(1) if found else ""
    what = message[: found.start()] if found else message
    if unknown := re.match(r"Object contains unknown field `(.*)`", what):
        allowed = [field for field in _TABLES[path.split("[")[0]].__struct_fields__ if field != "gravity_m_s2"]
        return f"{label}: {f'{path}.{unknown.group(1)}'.lstrip('.')}: unknown key; allowed here: {', '.join(allowed)}"
    if missing := re.match(r"Object missing required field `(.*)`", what):
        return f"{label}: {f'{path}.{missing.group(1)}'.lstrip('.')}: missing; it must be given"
    if path == "mounting":
        what = f"must be one of {', '.join(MOUNTINGS)}, or gravity as [x, y, z] in m/s²"
    value = tree
    for key, index in re.findall(r"([^.\[\]]+)|\[(\d+)\]", path):
        value = value[int(index) if index else key]
    return f"{label}: {path or 'the file'} = {value!r}: {what[0].lower()}{what[1:]}"
