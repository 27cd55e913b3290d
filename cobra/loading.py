"""Load a robot description from TOML; whatever is wrong is told in one line: file, key, value, and what is allowed."""

import math
import re
import tomllib
from collections import Counter
from importlib import resources
from pathlib import Path
from typing import Any

import msgspec

from cobra.description import Drive, Range, RobotDescription, Section
from cobra.errors import OperatorError
from cobra.plausible import implausible


class DescriptionError(OperatorError):
    """A description that cannot be used. The message names file, key, value and what is allowed."""


def robot_names() -> tuple[str, ...]:
    """The robots that come with the program."""
    folder = resources.files("cobra") / "robots"
    return tuple(sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml")))


def load_description(name_or_path: str | Path) -> RobotDescription:
    """Load a robot by the name of a preset or by the path of a TOML file.

    Raises:
        DescriptionError: the file is missing or not TOML, or a key is unknown, missing, of the wrong type or impossible.
    """
    description = parse_description(description_text(name_or_path), _label(name_or_path))
    return description if _is_preset(name_or_path) else _beside(description, Path(name_or_path).parent)


def parse_description(text: str, label: str) -> RobotDescription:
    """Validate a description's TOML text; `label` names it in messages.

    Raises:
        DescriptionError: as `load_description`.
    """
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise DescriptionError(f"{label}: not valid TOML: {error}") from None
    try:
        description = msgspec.convert(tree, RobotDescription)
    except msgspec.ValidationError as error:
        raise DescriptionError(_explain(label, tree, str(error))) from None
    for complaint in contradictions(description):
        raise DescriptionError(f"{label}: {complaint}")
    return description


def assumed_numbers(description: RobotDescription) -> tuple[str, ...]:
    """Key paths of every number that no source gives (`[provenance]`)."""
    tree = msgspec.to_builtins(description)
    tree.pop("provenance")
    return tuple(path for path in _number_paths(tree, "") if path not in description.provenance.given)


def description_text(name_or_path: str | Path) -> str:
    """The TOML text of a preset or of a file.

    Raises:
        DescriptionError: the file cannot be read.
    """
    if _is_preset(name_or_path):
        return (resources.files("cobra") / "robots" / f"{name_or_path}.toml").read_text("utf-8")
    try:
        return Path(name_or_path).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise DescriptionError(
            f"{name_or_path}: cannot be read ({reason}); give a file or one of the robots {', '.join(robot_names())}"
        ) from None


def _beside(description: RobotDescription, folder: Path) -> RobotDescription:
    """Files that a description names lie beside it, wherever it is read from."""
    wanted = description.compensation
    if wanted is None or not wanted.parameters:
        return description
    beside = msgspec.structs.replace(wanted, parameters=str(folder / wanted.parameters))
    return msgspec.structs.replace(description, compensation=beside)


def _is_preset(name_or_path: str | Path) -> bool:
    return isinstance(name_or_path, str) and name_or_path in robot_names()


def _label(name_or_path: str | Path) -> str:
    return f"{name_or_path}.toml" if _is_preset(name_or_path) else str(name_or_path)


def _number_paths(node: Any, path: str) -> list[str]:
    if isinstance(node, dict):
        return [p for key, child in node.items() for p in _number_paths(child, f"{path}.{key}" if path else str(key))]
    if isinstance(node, list | tuple):
        return [p for i, child in enumerate(node) for p in _number_paths(child, f"{path}[{i}]")]
    return [path] if isinstance(node, int | float) and not isinstance(node, bool) else []


def _explain(label: str, tree: Any, message: str) -> str:
    """Turn msgspec's message into file, key, value and what is allowed."""
    found = re.search(r" - at `(key in )?\$(.*)`$", message)
    path = found.group(2).lstrip(".") if found else ""
    what = message[: found.start()] if found else message
    if unknown := re.match(r"Object contains unknown field `(.*)`", what):
        key = f"{path}.{unknown.group(1)}".lstrip(".")
        return f"{label}: {key}: unknown key; allowed here: {', '.join(_allowed_keys(path))}"
    if what.startswith("Invalid enum value"):
        what = f"must be one of {', '.join(_allowed_values(path))}"
    if missing := re.match(r"Object missing required field `(.*)`", what):
        key = f"{path}.{missing.group(1)}".lstrip(".")
        return f"{label}: {key}: missing; it must be given"
    return f"{label}: {path or 'the file'} = {_value_at(tree, path)!r}: {what[0].lower()}{what[1:]}"


def _allowed_values(path: str) -> list[str]:
    parent, _, key = path.rpartition(".")
    fields = msgspec.inspect.type_info(_struct_at(parent)).fields  # type: ignore[attr-defined]
    kind = next(f.type for f in fields if f.encode_name == key)
    literals = [kind, *getattr(kind, "types", ())]
    return [str(value) for literal in literals for value in getattr(literal, "values", ())]


def _steps(path: str) -> list[str | int]:
    return [int(i) if i else key for key, i in re.findall(r"([^.\[\]]+)|\[(\d+)\]", path)]


def _value_at(tree: Any, path: str) -> Any:
    for step in _steps(path):
        if step == "...":
            return tree
        tree = tree[step]
    return tree


def _allowed_keys(path: str) -> list[str]:
    return list(_struct_at(path).__struct_fields__)


def _struct_at(path: str) -> Any:
    """The table type at a path, following the annotations."""
    kind: Any = RobotDescription
    for step in _steps(path):
        info = msgspec.inspect.type_info(kind)
        if isinstance(step, int) or step == "...":
            continue
        if isinstance(info, msgspec.inspect.StructType):
            kind = _struct_in(next(f.type for f in info.fields if f.encode_name == step)) or kind
    return kind


def _struct_in(info: Any) -> Any:
    if isinstance(info, msgspec.inspect.StructType):
        return info.cls
    children = [getattr(info, name, None) for name in ("item_type", "value_type", "type")] + [
        *getattr(info, "types", ())
    ]
    return next((found for child in children if child is not None and (found := _struct_in(child))), None)


def contradictions(d: RobotDescription) -> list[str]:
    """What the types cannot say: numbers that contradict each other, names that point nowhere."""
    return [
        *_not_finite(d),
        *_wrong_sections(d),
        *_wrong_ranges(d),
        *_wrong_drives(d),
        *implausible(d),
        *_wrong_provenance(d),
    ]


def _not_finite(d: RobotDescription) -> list[str]:
    tree = msgspec.to_builtins(d)
    values = ((path, _value_at(tree, path)) for path in _number_paths(tree, ""))
    return [f"{path} = {value}: must be a finite number" for path, value in values if not math.isfinite(value)]


def _wrong_sections(d: RobotDescription) -> list[str]:
    out = []
    for i, section in enumerate(d.sections):
        key = f"sections[{i}]"
        pitch = section.length_m / section.vertebrae
        if section.vertebra_thickness_m >= pitch:
            out.append(
                f"{key}.vertebra_thickness_m = {section.vertebra_thickness_m}: must be under the pitch "
                f"length_m / vertebrae = {pitch:.6g}"
            )
        routing = section.routing
        if routing and len(routing.names) != len(routing.azimuths_deg):
            out.append(
                f"{key}.routing.azimuths_deg = {list(routing.azimuths_deg)}: must have one azimuth for each of the "
                f"{len(routing.names)} names"
            )
        if routing and routing.radius_m >= d.backbone.diameter_m / 2:
            out.append(f"{key}.routing.radius_m = {routing.radius_m}: must be under half of backbone.diameter_m")
        if routing and _one_sided(routing.azimuths_deg):
            out.append(
                f"{key}.routing.azimuths_deg = {list(routing.azimuths_deg)}: the tendons must surround the backbone "
                "(no gap of 180 degrees or more), else one direction cannot be pulled"
            )
        if not section.elongation and section.max_bend_deg > (stop := _stop_deg(d, section)):
            out.append(
                f"{key}.max_bend_deg = {section.max_bend_deg:g}: the vertebrae meet at {stop:.0f} degrees; "
                "allow less bend, or make them thinner or more of them"
            )
        out += _wrong_elongation(f"{key}.elongation", section)
    if d.active_length_m > d.backbone.total_length_m:
        out.append(
            f"backbone.total_length_m = {d.backbone.total_length_m}: shorter than the sections together "
            f"({d.active_length_m:g} m)"
        )
    if any(section.active for section in d.sections) and d.tendon is None:
        out.append("tendon: missing; a robot with tendons must say what they are made of")
    for name, count in Counter(d.tendon_names).items():
        if count > 1:
            out.append(f"sections.routing.names: tendon {name!r} is named {count} times; names must be unique")
    return out


def _wrong_elongation(key: str, section: Section) -> list[str]:
    part = section.elongation
    if part is None:
        return []
    out = []
    if not part.locked_length_m < part.unlocked_length_m:
        out.append(
            f"{key}.locked_length_m = {part.locked_length_m:g}: must be under unlocked_length_m = {part.unlocked_length_m:g}"
        )
    if part.locked_length_m < section.vertebra_thickness_m:
        out.append(
            f"{key}.locked_length_m = {part.locked_length_m:g}: the guiders touch at vertebra_thickness_m = "
            f"{section.vertebra_thickness_m:g}; must be at least that"
        )
    shortest = section.vertebrae * part.locked_length_m
    if part.range_m[0] < shortest - 1e-9:
        out.append(
            f"{key}.range_m = {list(part.range_m)}: the guiders touch at {section.vertebrae} x locked_length_m = {shortest:g}"
        )
    if part.unlocked_length_m * section.vertebrae > section.length_m:
        out.append(
            f"{key}.unlocked_length_m = {part.unlocked_length_m:g}: of a chamber; must be at most "
            f"length_m / vertebrae = {section.length_m / section.vertebrae:g}"
        )
    return out


def _stop_deg(d: RobotDescription, section: Section) -> float:
    """Bend at which the vertebrae of a section touch: at their rims, or at the tendons' holes on a diagonal."""
    gap = section.length_m / section.vertebrae - section.vertebra_thickness_m
    joint = 2.0 * math.atan(gap / d.backbone.diameter_m)
    if section.routing:
        joint = min(joint, math.sqrt(2.0) * math.atan(gap / (2.0 * section.routing.radius_m)))
    return math.degrees(joint) * section.vertebrae


def _one_sided(azimuths_deg: tuple[float, ...]) -> bool:
    around = sorted(a % 360.0 for a in azimuths_deg)
    gaps = [b - a for a, b in zip(around, [*around[1:], around[0] + 360.0], strict=True)]
    return max(gaps) >= 180.0 - 1e-9


def _wrong_ranges(d: RobotDescription) -> list[str]:
    ranges: dict[str, Range] = {f"drives[{i}].travel_range": drive.travel_range for i, drive in enumerate(d.drives)}
    if d.twist:
        ranges["twist.range_deg"] = d.twist.range_deg
    if d.feed:
        ranges["feed.range_m"] = d.feed.range_m
    for i, section in enumerate(d.sections):
        if section.elongation:
            ranges[f"sections[{i}].elongation.range_m"] = section.elongation.range_m
    outside = [
        f"sections[{i}].length_m = {section.length_m}: must lie in elongation.range_m = {list(section.elongation.range_m)}"
        for i, section in enumerate(d.sections)
        if section.elongation and not section.elongation.range_m[0] <= section.length_m <= section.elongation.range_m[1]
    ]
    out = outside + [
        f"{key} = [{low}, {high}]: the first must be under the second"
        for key, (low, high) in ranges.items()
        if low >= high
    ]
    if d.feed and not d.feed.range_m[0] <= d.feed.start_m <= d.feed.range_m[1]:
        out.append(f"feed.start_m = {d.feed.start_m}: must lie in feed.range_m = {list(d.feed.range_m)}")
    if d.feed and d.hand_fed:
        out.append("hand_fed = true: not beside [feed]; a drive or a hand, not both")
    if d.feed and d.feed.range_m[1] > d.backbone.total_length_m:
        out.append(
            f"feed.range_m = {list(d.feed.range_m)}: beyond backbone.total_length_m = {d.backbone.total_length_m}"
        )
    if d.tendon and not d.tendon.min_tension_N < d.tendon.pretension_N < d.tendon.max_tension_N:
        out.append(
            f"tendon.pretension_N = {d.tendon.pretension_N}: must lie between min_tension_N = {d.tendon.min_tension_N} "
            f"and max_tension_N = {d.tendon.max_tension_N}"
        )
    for i, motor in enumerate(d.motors):
        if motor.min_voltage_V >= motor.max_voltage_V:
            out.append(f"motors[{i}].min_voltage_V = {motor.min_voltage_V}: must be under max_voltage_V")
    return out


def _wrong_drives(d: RobotDescription) -> list[str]:
    out = []
    buses = {bus.name for bus in d.buses}
    motors = {motor.name: motor for motor in d.motors}
    for table, parts in (("sections", d.sections), ("motors", d.motors), ("buses", d.buses), ("drives", d.drives)):
        for name, count in Counter(part.name for part in parts).items():
            if count > 1:
                out.append(f"{table}.name = {name!r}: used {count} times; names must be unique")
    seen: dict[tuple[str, int], str] = {}
    pulled: dict[str, str] = {}
    for i, drive in enumerate(d.drives):
        key = f"drives[{i}]"
        if drive.motor not in motors:
            out.append(f"{key}.motor = {drive.motor!r}: no such motor; described are {', '.join(motors)}")
            continue
        if drive.bus not in buses:
            out.append(f"{key}.bus = {drive.bus!r}: no such bus; described are {', '.join(sorted(buses))}")
        if other := seen.get((drive.bus, drive.address)):
            out.append(
                f"{key}.address = {drive.address}: drive {drive.name!r} has the address of drive {other!r} "
                f"on bus {drive.bus!r}; every drive needs its own"
            )
        seen[(drive.bus, drive.address)] = drive.name
        if motors[drive.motor].protocol.startswith("rmd") and drive.address > 32:
            out.append(f"{key}.address = {drive.address}: RMD drives have addresses 1 to 32")
        if motors[drive.motor].protocol == "cia402" and drive.address == 127:
            out.append(
                f"{key}.address = {drive.address}: CiA 402 drives have node ids 1 to 126; 127 is the controller's"
            )
        out += _wrong_transmission(d, key, drive)
        if drive.moves == "tendon" and drive.tendon in pulled:
            out.append(f"{key}.tendon = {drive.tendon!r}: drive {pulled[drive.tendon]!r} pulls it already")
        if drive.moves == "tendon" and drive.tendon:
            pulled[drive.tendon] = drive.name
    for bus_name in sorted(buses):
        protocols = sorted({motors[x.motor].protocol for x in d.drives if x.bus == bus_name and x.motor in motors})
        if "cia402" in protocols and len(protocols) > 1:
            out.append(
                f"buses: bus {bus_name!r} has drives of {' and '.join(protocols)}; give CiA 402 drives a bus of their own"
            )
    for name in d.tendon_names:
        if name not in pulled:
            out.append(f"drives: tendon {name!r} is missing: no drive has tendon = {name!r}")
    for what, part in (("twist", d.twist), ("feed", d.feed)):
        count = sum(drive.moves == what for drive in d.drives)
        if count != (part is not None):
            out.append(
                f"drives: {count} with moves = {what!r}; with{'' if part else 'out'} [{what}] there must be {int(part is not None)}"
            )
    return out


def _wrong_transmission(d: RobotDescription, key: str, drive: Drive) -> list[str]:
    out = []
    needed, other = ("reduction", "spool_radius_m") if drive.moves == "twist" else ("spool_radius_m", "reduction")
    if getattr(drive, needed) is None:
        out.append(f"{key}.{needed}: missing; a drive that moves a {drive.moves} must give it")
    if getattr(drive, other) is not None:
        value = getattr(drive, other)
        out.append(f"{key}.{other} = {value}: not for a drive that moves a {drive.moves}; give {needed}")
    if drive.moves == "tendon" and drive.tendon not in d.tendon_names:
        out.append(f"{key}.tendon = {drive.tendon!r}: no such tendon; the sections name {', '.join(d.tendon_names)}")
    if drive.moves != "tendon" and drive.tendon is not None:
        out.append(f"{key}.tendon = {drive.tendon!r}: only for a drive with moves = 'tendon'")
    return out


def _wrong_provenance(d: RobotDescription) -> list[str]:
    tree = msgspec.to_builtins(d)
    known = set(_number_paths(tree, ""))
    strangers = (path for path in d.provenance.given if path not in known)
    return [f"provenance.given: {path!r} names no number of this file" for path in strangers]
