"""What a calibration knows and what it does not, and the files that keep it.

Uncertainty is block-robust: neighbouring errors are alike, so the scatter of the gradient between blocks (motions), not
between samples, tells how far the parameters would move with another recording. With whitened parameters the prior has
variance one; a parameter whose variance the data hardly reduces, the data cannot tell.
"""

import tomllib
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec
import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription
from cobra.loading import contradictions
from cobra.mechanics.calibration import ROBUST, Calibration, Fit, Sequence, predict, residuals
from cobra.mechanics.model_selection import Selection
from cobra.mechanics.recordings import Recording
from cobra.mechanics.robot_model import EFFECTS, Block, RobotModel, blocks, nominal
from cobra.mechanics.tables import RecordingError
from cobra.mechanics.tendon_statics import Drive
from cobra.mechanics.toml_text import toml_text

Floats = NDArray[np.float64]

TOLD = 0.5
"""The data tell a parameter if they at least halve what is usual for it."""
SHARE = 0.3
"""Members of a combination that are named, as a share of its largest."""
NORMAL_95 = 1.96


@dataclass(frozen=True)
class Parameter:
    """One calibrated number with its 95 % interval, in SI units."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    told: float
    """Standard deviation over the prior's: 0 fully told by the data, 1 not at all."""

    @property
    def is_told(self) -> bool:
        return self.told < TOLD


@dataclass(frozen=True)
class Knowledge:
    """What the data say about the parameters."""

    parameters: tuple[Parameter, ...]
    singular_values: Floats
    """(size,) of the weighted Jacobian by the whitened parameters: under 1 the prior says more than the data."""
    untold: tuple[str, ...]
    """Combinations of parameters that the data cannot tell, least known first."""


@dataclass(frozen=True)
class Errors:
    """Tip errors of a recording [m]."""

    samples: int
    mean_m: float
    median_m: float
    p95_m: float
    max_m: float
    relative: float
    """Mean over the robot's length."""
    by_block: tuple[tuple[str, int, float], ...]
    """Name, samples and mean of each block."""


def knowledge(fit: Fit, seen: Sequence) -> Knowledge:
    """Intervals of the parameters, and what cannot be told."""
    model = fit.model
    scale = 1.0 / (fit.doubt * float(model.robot.length_m.sum()))
    error, jacobian = residuals(model, fit.x, seen, np.ones(len(seen.tip_m), dtype=np.bool_))
    error, jacobian = scale * error, scale * jacobian
    weight = 1.0 / np.sqrt(1.0 + (error * fit.doubt / ROBUST) ** 2)
    tall = (np.sqrt(weight)[..., None] * jacobian).reshape(-1, model.size)
    gradient = np.einsum("nep,ne->np", jacobian, weight * error)
    sums = np.array([gradient[seen.block == block].sum(axis=0) for block in np.unique(seen.block)])
    inverse = np.linalg.inv(tall.T @ tall + np.eye(model.size))
    scatter = sums.T @ sums * len(sums) / max(len(sums) - 1, 1)
    deviation = np.sqrt(np.diag(inverse @ (scatter + np.eye(model.size)) @ inverse))
    _, singular, rows = np.linalg.svd(tall, full_matrices=True)
    return Knowledge(tuple(_parameters(fit, deviation)), singular, tuple(_untold(model, singular, rows)))


def _parameters(fit: Fit, deviation: Floats) -> list[Parameter]:
    out = []
    at = 0
    for block in fit.model.free:
        for i in np.flatnonzero(block.free):
            middle = block.nominal[i] + block.sigma * fit.x[at]
            half = NORMAL_95 * block.sigma * deviation[at]
            numbers = np.array([middle, middle - half, middle + half])
            value, low, high = (float(v) for v in (np.exp(numbers) if block.logarithmic else numbers))
            out.append(
                Parameter(f"{block.name}[{block.labels[i]}]", block.unit, value, low, high, float(deviation[at]))
            )
            at += 1
    return out


def _untold(model: RobotModel, singular: Floats, rows: Floats) -> list[str]:
    out = []
    for value, row in sorted(zip(singular, rows, strict=True), key=lambda pair: float(pair[0])):
        if value >= 1.0:
            break
        order = np.argsort(-np.abs(row))
        members = [i for i in order if abs(row[i]) >= SHARE * abs(row[order[0]])][:6]
        sign = np.sign(row[order[0]])
        text = " ".join(f"{'+' if sign * row[i] > 0 else '−'} {model.labels[i]}" for i in members)
        out.append(text.removeprefix("+ "))
    return out


def errors(fit: Fit, predicted_m: Floats, recording: Recording) -> Errors:
    """Errors of predicted tips (N, 3) over all samples of a recording and by block."""
    off = np.linalg.norm(predicted_m - recording.tip_m, axis=-1)
    blocks_of = [(name, recording.block == i) for i, name in enumerate(recording.block_names)]
    return Errors(
        len(off),
        float(off.mean()),
        float(np.median(off)),
        float(np.quantile(off, 0.95)),
        float(off.max()),
        float(off.mean() / fit.model.robot.length_m.sum()),
        tuple((name, int(rows.sum()), float(off[rows].mean())) for name, rows in blocks_of),
    )


def predict_after(calibration: Calibration, first: Recording, then: Recording) -> Floats:
    """Tips (N, 3) [m] of a second recording, which follows the first: its tendons have aged on, and what slips remembers.

    Where its clock began anew, it is taken to follow at once. Only its tendons are looked at, not its tips.
    """
    step = float(np.median(np.diff(first.time_s)))
    late = then.time_s[0] > first.time_s[-1]
    shift = 0.0 if late else float(first.time_s[-1] + step - then.time_s[0])
    parts = [calibration.sequence(first), calibration.sequence(replace(then, time_s=then.time_s + shift))]
    drive = Drive(*(np.concatenate(both) for both in zip(parts[0].drive, parts[1].drive, strict=True)))
    return predict(calibration.fit, replace(parts[1], drive=drive))[0][len(first) :]


def calibrated_description(calibration: Calibration, recording: Recording) -> RobotDescription:
    """The description with calibrated lengths, bending stiffnesses, azimuths, tendon stiffness, spool radii and, where
    the recording gave the angles of the shafts, the drives' direction.

    Rest bends, zeros, play, friction, creep and the like have no place in a description; `calibration_text` keeps them.
    The scale of all stiffnesses stays the described one of the first section: tip positions tell ratios only.

    Raises:
        RecordingError: the calibrated numbers contradict each other.
    """
    model, values = calibration.fit.model, calibration.fit.values
    robot, described = model.robot, model.robot.description
    stiffness = robot.stiffness_Nm * robot.bending * np.concatenate([np.ones(1), values.bending_ratio])
    changed: list[str] = []
    sections = []
    for i, section in enumerate(described.sections):
        routing = section.routing
        if routing is not None:
            azimuths = np.degrees(values.azimuth[robot.ends == i]) % 360.0
            routing = msgspec.structs.replace(routing, azimuths_deg=tuple(round(float(a), 3) for a in azimuths))
            changed += [f"sections[{i}].routing.azimuths_deg[{j}]" for j in range(len(azimuths))]
        length = round(float(values.length[i]), 6)
        bending = section.bending_stiffness_Nm2
        if model.slack:
            bending = float(stiffness[i] * values.length[i])
            changed.append(f"sections[{i}].bending_stiffness_Nm2")
        sections.append(
            msgspec.structs.replace(section, length_m=length, bending_stiffness_Nm2=bending, routing=routing)
        )
        changed.append(f"sections[{i}].length_m")
    drives = list(described.drives)
    for gain, i in zip(values.gain, described.tendon_drives, strict=True):
        radius = drives[i].spool_radius_m or 0.0
        turned = calibration.sign if recording.of_shafts else 1
        drives[i] = msgspec.structs.replace(
            drives[i], spool_radius_m=round(float(radius * gain), 7), direction=turned * drives[i].direction
        )
        changed.append(f"drives[{i}].spool_radius_m")
    tendon = described.tendon
    if model.slack and tendon is not None:
        free = tendon.conduit_length_m + np.cumsum(values.length)[list(described.active_sections)]
        tendon = msgspec.structs.replace(tendon, axial_stiffness_N=float(np.mean(values.tendon_stiffness * free)))
        changed.append("tendon.axial_stiffness_N")
    longer = sum(section.length_m for section in sections) - described.active_length_m
    backbone = msgspec.structs.replace(
        described.backbone, total_length_m=round(described.backbone.total_length_m + longer, 6)
    )
    changed.append("backbone.total_length_m")
    given = {**described.provenance.given, **dict.fromkeys(changed, f"calibrated on {recording.source}")}
    made = msgspec.structs.replace(
        described,
        backbone=backbone,
        sections=tuple(sections),
        drives=tuple(drives),
        tendon=tendon,
        provenance=msgspec.structs.replace(described.provenance, given=given),
    )
    for complaint in contradictions(made):
        raise RecordingError(f"the calibrated description contradicts itself: {complaint}")
    return made


def description_text(description: RobotDescription) -> str:
    """A description as TOML that `load_description` reads."""
    return toml_text(msgspec.to_builtins(description))


def calibration_text(
    calibration: Calibration, source: str, known: Knowledge, found: Errors, selection: Selection
) -> str:
    """All parameters of a calibration as TOML that `load_calibration` reads, with what was tried and how well it held."""
    model, values = calibration.fit.model, calibration.fit.values
    return toml_text(
        {
            "robot": model.robot.description.name,
            "source": source,
            "effects": list(model.effects),
            "reference_time_s": calibration.reference_s,
            "travel_sign": calibration.sign,
            "oriented": model.oriented,
            "mean_tip_error_m": found.mean_m,
            "held_out_tip_error_m": {
                fold.name: float(error)
                for fold, error in zip(selection.folds, selection.chosen.held_out_m, strict=True)
            },
            "values": {block.name: getattr(values, block.name).tolist() for block in model.free},
            "interval_95": {p.name: [p.low, p.high] for p in known.parameters},
            "untold": {
                "parameters": [p.name for p in known.parameters if not p.is_told],
                "together": list(known.untold),
            },
        }
    )


def load_calibration(path: Path, description: RobotDescription) -> Calibration:
    """Read what `calibration_text` wrote, for the description with which the calibration began.

    Raises:
        RecordingError: the file cannot be read, or is of another robot.
    """
    robot = nominal(description)
    every = blocks(robot)
    try:
        tree = tomllib.loads(path.read_text("utf-8"))
        effects = tuple(effect for effect in tree["effects"] if effect in EFFECTS)
        model = RobotModel(robot, every, effects, bool(tree["oriented"]))
        kept = {block.name: _with_nominal(block, tree["values"][block.name]) for block in model.free}
        model = replace(model, blocks={**every, **kept})
        fit = Fit(model, np.zeros(model.size), float("nan"))
        return Calibration(fit, float(tree["reference_time_s"]), int(tree["travel_sign"]))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError, KeyError, TypeError, ValueError) as error:
        raise RecordingError(f"{path}: is no calibration of {description.name} ({error})") from None


def _with_nominal(block: Block, values: list[float]) -> Block:
    array = np.array(values, dtype=np.float64)
    if array.shape != block.nominal.shape:
        raise ValueError(f"{block.name} has {array.size} values, not {block.nominal.size}")
    return block._replace(nominal=np.log(array) if block.logarithmic else array)
