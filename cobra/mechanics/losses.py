"""What lies between the drives and the shape: stretch, friction and lost motion of the tendons, and how stiff the body is.

Values come from the description, from a file that a calibration wrote, or from a guided sweep (`loss_identification.py`).
"""

import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.errors import OperatorError
from cobra.plausible import MAX_CAPSTAN, MAX_FRICTION, MODULUS_RANGE_Pa

Floats = NDArray[np.float64]

DESCRIBED_SPREAD = 0.3
"""Numbers of a description are within this share of the robot's, by experience."""
TABLES = ("losses", "deviation")
"""Of a file of loss parameters, beside where they come from."""
ASSUMED_SETTLING_S = 0.3
"""No description says how fast a section straightens when it is let go."""


class LossesError(OperatorError):
    """Loss parameters that cannot be used. The message names file, key and what would be right."""


@dataclass(frozen=True)
class Losses:
    """Loss parameters of one robot: m tendons in the order of the description, n sections."""

    axial_stiffness_N: float
    """EA of a tendon."""
    drive_friction_N: Floats
    """(m,) gear friction as tension at the spool."""
    backlash_m: Floats
    """(m,) lost motion of a drive on a reversal, as travel."""
    hole_friction: float
    """μ along bent sections: exp(−μ θ)."""
    conduit_capstan: float
    """μ Θ of the conduit."""
    radius_m: Floats
    """(n,) routing radius; 0 for a passive section."""
    bending_stiffness_Nm2: Floats
    """(n,) EI"""
    settling_s: float
    """Viscous friction of a bending section over its stiffness: the time in which it straightens by itself."""

    @classmethod
    def described(cls, description: RobotDescription) -> "Losses":
        """The numbers of the description."""
        tendon = description.tendon
        drives = [description.drives[i] for i in description.tendon_drives]
        per_rad = np.array([abs(drive.travel_per_rad) for drive in drives])
        motors = [description.motor_of(drive) for drive in drives]
        return cls(
            axial_stiffness_N=tendon.axial_stiffness_N if tendon else math.inf,
            drive_friction_N=np.array([motor.back_drive_torque_Nm for motor in motors]) / per_rad,
            backlash_m=np.radians([motor.backlash_deg for motor in motors]) * per_rad,
            hole_friction=tendon.hole_friction if tendon else 0.0,
            conduit_capstan=tendon.conduit_friction * tendon.conduit_bend_rad if tendon else 0.0,
            radius_m=np.array([s.routing.radius_m if s.routing else 0.0 for s in description.sections]),
            bending_stiffness_Nm2=np.array([s.bending_stiffness_Nm2 for s in description.sections]),
            settling_s=ASSUMED_SETTLING_S,
        )

    def applied(self, description: RobotDescription) -> RobotDescription:
        """The description with these routing radii and bending stiffnesses."""
        sections = tuple(
            msgspec.structs.replace(
                section,
                bending_stiffness_Nm2=float(stiffness),
                routing=msgspec.structs.replace(section.routing, radius_m=float(radius)) if section.routing else None,
            )
            for section, radius, stiffness in zip(
                description.sections, self.radius_m, self.bending_stiffness_Nm2, strict=True
            )
        )
        return msgspec.structs.replace(description, sections=sections)


@dataclass(frozen=True)
class Identified:
    """Losses with the standard deviation of each number (same shapes), and where they come from."""

    losses: Losses
    deviation: Losses
    source: str


def described(description: RobotDescription) -> Identified:
    """The description's own numbers, trusted as evenly spread within ±30 %."""
    losses = Losses.described(description)
    share = DESCRIBED_SPREAD / math.sqrt(3.0)
    parts: dict[str, Any] = {field.name: np.abs(getattr(losses, field.name)) * share for field in fields(Losses)}
    return Identified(losses, replace(losses, **parts), "the description")


def to_text(identified: Identified) -> str:
    """TOML of `Identified`, for `from_text`."""
    values = {
        "source": identified.source,
        "losses": _plain(identified.losses),
        "deviation": _plain(identified.deviation),
    }
    return _toml(values)


def from_text(text: str, description: RobotDescription, label: str) -> Identified:
    """Read what `to_text` wrote.

    Raises:
        LossesError: it is not TOML, a key is missing or unknown, a number is not finite, negative or contradicts physics,
            or it belongs to another robot.
    """
    try:
        tree = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise LossesError(f"{label}: not valid TOML: {error}") from None
    _only(tree, ("source", *TABLES), label)
    shape = Losses.described(description)
    losses, deviation = (_losses(tree.get(table), shape, f"{label}: {table}", table == "losses") for table in TABLES)
    for complaint in _implausible(losses, description):
        raise LossesError(f"{label}: losses.{complaint}")
    return Identified(losses, deviation, str(tree.get("source", label)))


def load(path: Path, description: RobotDescription) -> Identified:
    """Read a file of loss parameters. Raises LossesError as `from_text`, or when it cannot be read."""
    try:
        return from_text(path.read_text("utf-8"), description, str(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise LossesError(
            f"{path}: cannot be read ({reason}); write it with `cobra-teleop identify friction --out {path}`"
        ) from None


def _losses(tree: Any, like: Losses, label: str, positive: bool) -> Losses:
    if not isinstance(tree, dict):
        raise LossesError(f"{label}: missing; write the file with `cobra-teleop identify friction --out FILE`")
    _only(tree, [field.name for field in fields(Losses)], label)
    parts: dict[str, Any] = {}
    for field in fields(Losses):
        key = f"{label}.{field.name}"
        if field.name not in tree:
            raise LossesError(f"{key}: missing; it must be given")
        expected = np.asarray(getattr(like, field.name))
        try:
            value = _numbers(tree[field.name])
        except (TypeError, ValueError):
            raise LossesError(f"{key} = {tree[field.name]!r}: must be numbers") from None
        if value.shape != expected.shape:
            raise LossesError(f"{key}: {value.size} numbers for {expected.size}: this file is of another robot")
        if not np.all(np.isfinite(value)) or np.any(value < 0.0):
            raise LossesError(f"{key} = {tree[field.name]!r}: must be finite and not negative")
        divides = positive and field.name in ("axial_stiffness_N", "radius_m", "bending_stiffness_Nm2")
        if divides and np.any((value == 0.0) & (expected > 0.0)):
            raise LossesError(f"{key} = {tree[field.name]!r}: must be greater than 0")
        parts[field.name] = value if expected.ndim else float(value)
    return Losses(**parts)


def _numbers(value: Any) -> Floats:
    """Raises TypeError or ValueError for what is no number or list of numbers."""
    given = np.asarray(value)
    if given.dtype.kind not in "iuf":
        raise TypeError(value)
    return given.astype(np.float64)


def _only(tree: dict[str, Any], known: Sequence[str], label: str) -> None:
    for key in tree:
        if key not in known:
            raise LossesError(f"{label}: unknown key {key!r}; there are {', '.join(known)}")


def _implausible(losses: Losses, d: RobotDescription) -> list[str]:
    """What contradicts physics: key, value, reason. The same bounds as a description's."""
    out = []
    low, high = (modulus * math.pi * d.tendon.diameter_m**2 / 4 if d.tendon else 0.0 for modulus in MODULUS_RANGE_Pa)
    if d.tendon and not low <= losses.axial_stiffness_N <= high:
        out.append(
            f"axial_stiffness_N = {losses.axial_stiffness_N:g}: a tendon {1e3 * d.tendon.diameter_m:g} mm thin, of whatever "
            f"material, has {low:.3g} to {high:.3g} N"
        )
    if losses.hole_friction > MAX_FRICTION:
        out.append(
            f"hole_friction = {losses.hole_friction:g}: a coefficient of friction; must be at most {MAX_FRICTION:g}"
        )
    if losses.conduit_capstan > MAX_CAPSTAN:
        out.append(
            f"conduit_capstan = {losses.conduit_capstan:g}: the conduit would lose the factor "
            f"exp({losses.conduit_capstan:.1f}) of the tension and the tendon be stuck; must be at most {MAX_CAPSTAN:g}"
        )
    if np.any(losses.radius_m > (radius := d.backbone.diameter_m / 2)):
        out.append(
            f"radius_m = {losses.radius_m.tolist()}: tendons run inside the body; must be at most {radius:g}, half of its "
            "diameter"
        )
    return out


def _plain(losses: Losses) -> dict[str, Any]:
    values = {field.name: getattr(losses, field.name) for field in fields(Losses)}
    return {name: value.tolist() if isinstance(value, np.ndarray) else float(value) for name, value in values.items()}


def _toml(values: dict[str, Any]) -> str:
    lines = [f"source = {msgspec.json.encode(values['source']).decode()}"]
    for table in TABLES:
        lines += ["", f"[{table}]", *(f"{name} = {value}" for name, value in values[table].items())]
    return "\n".join(lines) + "\n"
