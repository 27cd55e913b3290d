"""The body of `cobra-teleop identify calibrate`: read, calibrate, tell what is known, write files and pictures."""

import csv
import io
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import msgspec
import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Column, Table

from app.identify.figures import knowledge_figure, selection_figure, tip_figure
from app.identify.results import tell_skipped, write
from cobra.description import RobotDescription
from cobra.loading import load_description
from cobra.mechanics.calibration import predict
from cobra.mechanics.calibration_report import (
    Errors,
    Knowledge,
    calibrated_description,
    calibration_text,
    description_text,
    errors,
    knowledge,
    predict_after,
)
from cobra.mechanics.model_selection import Outcome, Selection, Trial, calibrate
from cobra.mechanics.recordings import ColumnMap, Recording, conventional_columns, load_columns, read_recording, thinned
from cobra.mechanics.robot_model import EFFECTS, nominal
from cobra.mechanics.tables import Floats

MM = 1e3
UNTOLD_SHOWN = 8
MOST_SAMPLES = 4000
"""More take longer to fit and tell no more: neighbouring samples repeat each other."""
PEOPLES_UNITS = {"m": (MM, "mm"), "rad": (180.0 / math.pi, "°")}
TravelPositive = Literal["wound-in", "paid-out", "unknown"]


@dataclass(frozen=True, kw_only=True)
class CalibrateOptions:
    """What the command line says."""

    recording: Path
    robot: str
    """Name or path of the description with nominal numbers."""
    columns: Path | None = None
    """TOML that maps the recording's columns; None: they are named as `conventional_columns` says."""
    travel_positive: TravelPositive | None = None
    """Overrides what the columns say."""
    validate: Path | None = None
    """Another recording, taken after the first, for the error only."""
    out: Path = Path("identified")
    model: Literal["select", "all", "plain"] = "select"
    skip_bad_rows: bool = False


def run_calibration(options: CalibrateOptions, console: Console | None = None) -> int:
    """Calibrate on the recording alone; look at the other one once, at the end, for the error.

    Raises:
        OperatorError: an input that cannot be used, or a folder that cannot be written.
    """
    console = console or Console()
    description = load_description(options.robot)
    robot = nominal(description)
    first = _read(console, options.recording, options, description)
    then = _read(console, options.validate, options, description) if options.validate else None
    rows = len(first)
    first = thinned(first, MOST_SAMPLES)
    console.print(
        f"{first.source}: {len(first)} samples{f' (of {rows} rows, evenly)' if rows > len(first) else ''} in "
        f"{len(first.block_names)} motions. Fitting takes minutes; each model is tried on motions held out.",
        highlight=False,
    )
    effects = {"select": None, "all": tuple(EFFECTS), "plain": ()}[options.model]
    outcome = calibrate(first, robot, effects=effects, report=_teller(console))
    calibration = outcome.calibration
    predicted = predict(calibration.fit, outcome.seen)[0]
    known = knowledge(calibration.fit, outcome.seen)
    found = errors(calibration.fit, predicted, first)
    texts = {
        "calibration.toml": calibration_text(calibration, first.source, known, found, outcome.selection),
        "tips.csv": _tips(first, predicted),
    }
    figures = {
        "tips.png": tip_figure(first.source, first, predicted),
        "parameters.png": knowledge_figure(known),
        "selection.png": selection_figure(outcome.selection),
    }
    shown = [("fitted to", first.source, found)]
    if then is not None:
        predicted_then = predict_after(calibration, first, then)
        shown.append(("held out", then.source, errors(calibration.fit, predicted_then, then)))
        texts["tips-held-out.csv"] = _tips(then, predicted_then)
        figures["tips-held-out.png"] = tip_figure(then.source, then, predicted_then)
    _tell(console, outcome, shown, known)
    write(console, options.out, texts, figures)
    made = calibrated_description(calibration, first)
    write(console, options.out, {"robot.toml": description_text(made)}, {})
    return 0


def _read(console: Console, path: Path, options: CalibrateOptions, description: RobotDescription) -> Recording:
    columns: ColumnMap = (
        load_columns(options.columns) if options.columns is not None else conventional_columns(path, description)
    )
    if options.travel_positive is not None:
        columns = msgspec.structs.replace(columns, travel_positive=options.travel_positive)
    recording = read_recording(path, columns, description, skip_bad_rows=options.skip_bad_rows)
    tell_skipped(console, recording.source, recording.skipped)
    return recording


def _teller(console: Console) -> Callable[[str, Trial], None]:
    def tell(effect: str, trial: Trial) -> None:
        verdict = "kept" if trial.kept else "not kept"
        console.print(f"  {effect:<28} tip error held out {MM * trial.score_m:6.2f} mm  {verdict}", highlight=False)

    return tell


def _tell(console: Console, outcome: Outcome, shown: list[tuple[str, str, Errors]], known: Knowledge) -> None:
    fit = outcome.calibration.fit
    console.print(f"effects: {', '.join(fit.model.effects) or 'none'}", highlight=False)
    if outcome.calibration.sign < 0:
        console.print("the travel's sign is the other one than the columns and the description say", highlight=False)
    table = Table(Column("tip error [mm]", no_wrap=True), "samples", "mean", "median", "95 %", "max", "mean / length")
    for what, source, e in shown:
        numbers = [f"{MM * v:.2f}" for v in (e.mean_m, e.median_m, e.p95_m, e.max_m)]
        table.add_row(escape(f"{what} {source}"), str(e.samples), *numbers, f"{100.0 * e.relative:.2f} %")
    console.print(_parameter_table(known))
    console.print("told: the data tell it better than what is usual for such robots", highlight=False)
    if known.untold:
        console.print("the data cannot tell these together, least known first:", highlight=False)
        for combination in known.untold[:UNTOLD_SHOWN]:
            console.print(f"  {combination}", highlight=False, markup=False)
    console.print(_held_out_table(outcome.selection))
    console.print(table)


def _held_out_table(selection: Selection) -> Table:
    """Tip error of each group of motions when the model is fitted without it."""
    table = Table("motions held out", "samples", "mean tip error [mm]")
    for fold, error in zip(selection.folds, selection.chosen.held_out_m, strict=True):
        table.add_row(escape(fold.name), str(int(fold.held_out.sum())), f"{MM * float(error):.2f}")
    return table


def _parameter_table(known: Knowledge) -> Table:
    table = Table(Column("parameter", no_wrap=True), "value", Column("95 % interval", no_wrap=True), "unit", "told")
    for p in known.parameters:
        scale, unit = PEOPLES_UNITS.get(p.unit, (1.0, p.unit))
        interval = f"{scale * p.low:.4g} … {scale * p.high:.4g}"
        told, style = ("yes", "") if p.is_told else ("no", "red")
        table.add_row(escape(p.name), f"{scale * p.value:.5g}", interval, unit, told, style=style)
    return table


def _tips(recording: Recording, predicted_m: Floats) -> str:
    """Measured and predicted tips and their distance as CSV."""
    off = np.linalg.norm(predicted_m - recording.tip_m, axis=-1)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    names = [f"{what}_{axis}_mm" for what in ("tip", "model") for axis in "xyz"]
    writer.writerow(["row", "time_s", "motion", *names, "error_mm"])
    for i in range(len(recording)):
        numbers = [*(MM * recording.tip_m[i]), *(MM * predicted_m[i]), MM * off[i]]
        motion = recording.block_names[recording.block[i]]
        writer.writerow(
            [int(recording.rows[i]), repr(float(recording.time_s[i])), motion, *(f"{number:.4f}" for number in numbers)]
        )
    return text.getvalue()
