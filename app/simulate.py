"""`cobra-teleop simulate`: run a load case of SRC-Bot, write its data and pictures, and show it."""

import csv
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from app.simulate_figures import write_figures
from cobra.errors import OperatorError
from cobra.mechanics.cases import Case, Reported, load_case
from cobra.mechanics.chain import Floats, SrcBotParameters, assumed_parameters
from cobra.mechanics.dynamics import DEFAULT_STEP_S, Formulation, Motion, simulate
from cobra.mechanics.measured import Difference, Measured, difference, read_measured

AXES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class SimulateOptions:
    """What the command line says."""

    case: str
    """Name of a case that comes with the program, or path of a TOML file."""
    out: Path | None = None
    """Folder for data and pictures; simulated/NAME by default."""
    formulation: Formulation = "chain"
    """The exact chain, or the paper's own equations."""
    step_ms: float | None = None
    """Fixed step."""
    tolerance_mm: float | None = None
    """Adapt the step so that one step errs less (chain only)."""
    measured: Path | None = None
    """CSV of a measured motion, laid over the pictures, with its error."""
    skip_bad_rows: bool = False
    """Leave out rows of the CSV that cannot be used, instead of stopping."""
    pictures: bool = True
    view: bool = False
    """Play the motion in the 3D scene until Ctrl-C."""
    port: int = 8090
    """Of the 3D scene; when it is taken the next free one is used."""


def run_simulation(options: SimulateOptions, console: Console | None = None) -> int:
    """The body of the command.

    Raises:
        OperatorError: the case, the recording or the output cannot be used, or the motion blew up.
    """
    console = console or Console()
    case = load_case(options.case)
    measured = _measured(options, case)
    console.print(f"[bold]{case.file.title}[/bold]  ({case.name}, {options.formulation})", highlight=False)
    if case.file.note:
        console.print(case.file.note, highlight=False)
    console.print(_assumed(case.parameters), highlight=False, style="dim")
    began = time.perf_counter()
    motion = _simulated(options, case, console)
    took = time.perf_counter() - began
    console.print(
        f"{case.file.duration_s:g} s in {took * 1e3:.0f} ms (compiling included), {motion.steps} steps, "
        f"{case.parameters.segments} segments.",
        highlight=False,
    )
    compared = difference(motion, measured) if measured is not None else None
    for table in tables(case, motion, measured, compared):
        console.print(table)
    for line in contacts(motion):
        console.print(line, highlight=False)
    folder = options.out or Path("simulated") / case.name
    for path in write(case, motion, folder, measured if options.pictures else None, pictures=options.pictures):
        console.print(f"wrote {path}", highlight=False)
    if options.view:
        from app.simulate_view import show  # noqa: PLC0415  (viser takes a second to import)

        show(motion, measured, options.port)
    return 0


def tables(case: Case, motion: Motion, measured: Measured | None, compared: Difference | None) -> list[Table]:
    """The guiders at the end; the paper's error bands beside this prediction; the measured errors."""
    out = [_end_table(motion)]
    if case.file.reported:
        out.append(_reported_table(case, motion))
    if measured is not None and compared is not None:
        out.append(_measured_table(measured, compared))
    return out


def contacts(motion: Motion) -> list[str]:
    """In words, which chambers met their stop and which locked, and when first."""
    out = []
    for flags, what in ((motion.stopped, "met its stop"), (motion.locked, "locked")):
        for i in np.flatnonzero(flags.any(axis=0)):
            held = flags[:, i]
            first = motion.time_s[int(np.argmax(held))]
            still = ", to the end" if held[-1] else ""
            out.append(f"Chamber {i + 1} {what} at {first:.2f} s{still}.")
    return out


def write(
    case: Case, motion: Motion, folder: Path, measured: Measured | None = None, *, pictures: bool = True
) -> list[Path]:
    """Data as CSV and NPZ, and pictures; the paths written.

    Raises:
        OperatorError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        out = [_write_csv(motion, folder / "motion.csv"), _write_npz(case, motion, folder / "motion.npz")]
        if pictures:
            out += write_figures(case, motion, measured, folder)
    except OSError as error:
        raise OperatorError(f"{folder}: cannot be written ({error.strerror or error}); choose another --out") from None
    return out


def _measured(options: SimulateOptions, case: Case) -> Measured | None:
    if options.measured is None:
        return None
    return read_measured(options.measured, case.parameters, skip_bad_rows=options.skip_bad_rows)


def _simulated(options: SimulateOptions, case: Case, console: Console) -> Motion:
    step_s = DEFAULT_STEP_S if options.step_ms is None else options.step_ms * 1e-3
    tolerance_m = None if options.tolerance_mm is None else options.tolerance_mm * 1e-3
    if tolerance_m is not None and options.formulation != "chain":
        raise OperatorError("the published equations take a fixed step; leave --tolerance-mm out, or give --step-ms")
    columns = (TextColumn("simulating"), BarColumn(), TextColumn("{task.completed:.1f} s"), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("", total=case.file.duration_s)
        try:
            return simulate(
                case.parameters,
                case.file.duration_s,
                case.cables,
                case.loads,
                start=case.chain(),
                formulation=options.formulation,
                step_s=step_s,
                tolerance_m=tolerance_m,
                record_s=case.file.record_s,
                progress=lambda now: progress.update(task, completed=now),
            )
        except ValueError as error:
            raise OperatorError(f"{case.name}: {error}") from None


def _assumed(parameters: SrcBotParameters) -> str:
    assumed = assumed_parameters(parameters)
    return f"Assumed, because the paper's text does not give them: {', '.join(assumed)}." if assumed else ""


def _end_table(motion: Motion) -> Table:
    table = Table(title="At the end", title_justify="left")
    for name in ("guider", "x mm", "y mm", "z mm", "tilt x °", "tilt y °", "length mm"):
        table.add_column(name, justify="right")
    positions, tilts = motion.positions_m[-1, 1:] * 1e3, np.degrees(motion.tilt_rad[-1, 1:])
    for i in range(motion.parameters.segments):
        values = [*positions[i], *tilts[i], motion.q[-1, i, 3] * 1e3]
        table.add_row(str(i + 1), *(_number(value) for value in values))
    return table


def _reported_table(case: Case, motion: Motion) -> Table:
    """Our prediction beside the bands; they are not the error of this prediction."""
    loaded = case.load_time_s
    ours = "by the load, at the end" if loaded is not None else "over the motion"
    table = Table(
        title="Our prediction, and the error the paper reports between its own model and its robot",
        caption=(
            "The bands are not the error of this prediction: the measured positions are not in the paper's text, "
            "nor are its masses, damping, friction and D_c."
        ),
        title_justify="left",
        caption_justify="left",
    )
    table.add_column("quantity")
    table.add_column("guiders")
    table.add_column(f"predicted {ours}", justify="right")
    table.add_column("paper's model against its robot", justify="right")
    table.add_column("")
    for band in case.file.reported:
        low, high = _predicted(band, motion, loaded)
        unit = "°" if band.quantity == "angle" else "mm"
        guiders = ", ".join(map(str, band.guiders)) or "all"
        predicted = _number(low) if low == high else f"{_number(low)} … {_number(high)}"
        table.add_row(band.quantity, guiders, f"{predicted} {unit}", _band(band, unit), band.note)
    return table


def _predicted(band: Reported, motion: Motion, loaded_s: float | None) -> tuple[float, float]:
    """Least and greatest over the guiders: the change that the load makes, or the values over the motion [mm, °]."""
    which = [i - 1 for i in band.guiders] or list(range(motion.parameters.segments))
    if band.quantity == "angle":
        values = np.degrees(motion.tilt_rad[:, 1:, 0][:, which])
    elif band.quantity == "position":
        values = 1e3 * motion.positions_m[:, 1:][:, which]
    else:
        values = 1e3 * motion.positions_m[:, 1:, AXES.index(band.quantity)][:, which]
    if loaded_s is not None:
        before = int(np.searchsorted(motion.time_s, loaded_s))
        values = values[-1] - values[before]
    return float(values.min()), float(values.max())


def _number(value: float) -> str:
    """One decimal, and no minus before a zero."""
    return f"{round(value, 1) + 0.0:.1f}"


def _band(band: Reported, unit: str) -> str:
    if band.low is None:
        return f"up to {band.high:g} {unit}"
    if band.high is None:
        return f"down to {band.low:g} {unit}"
    return f"{band.low:g} … {band.high:g} {unit}"


def _measured_table(measured: Measured, compared: Difference) -> Table:
    table = Table(
        title=f"Measured minus simulated: {measured.name}, {len(compared.time_s)} rows"
        + (f", {measured.skipped} skipped" if measured.skipped else ""),
        title_justify="left",
    )
    for name in ("guider", "quantity", "mean", "RMS", "least", "greatest"):
        table.add_column(name, justify="left" if name == "quantity" else "right")
    for i in range(compared.positions_m.shape[1]):
        rows: list[tuple[str, Floats]] = [
            *((f"{axis} mm", 1e3 * compared.positions_m[:, i, k]) for k, axis in enumerate(AXES)),
            *((f"tilt {axis} °", np.degrees(compared.tilt_rad[:, i, k])) for k, axis in enumerate(AXES[:2])),
        ]
        for name, error in rows:
            if not np.isnan(error).any():
                summary = (error.mean(), np.sqrt((error**2).mean()), error.min(), error.max())
                table.add_row(str(i + 1), name, *(f"{value:.2f}" for value in summary))
    return table


def _write_csv(motion: Motion, path: Path) -> Path:
    """One row a recorded time, in the columns that `read_measured` takes, then cables, loads and locks."""
    n, k = motion.parameters.segments, motion.tensions_N.shape[1]
    names, columns = ["time_s"], [motion.time_s]
    for i in range(n):
        names += [f"{axis}{i + 1}_m" for axis in AXES] + [f"tilt_{axis}{i + 1}_deg" for axis in AXES[:2]]
        columns += [*motion.positions_m[:, i + 1].T, *np.degrees(motion.tilt_rad[:, i + 1]).T]
    for i in range(n):
        names += [f"bend_x{i + 1}_deg", f"bend_y{i + 1}_deg", f"twist{i + 1}_deg", f"length{i + 1}_m", f"locked{i + 1}"]
        columns += [*np.degrees(motion.q[:, i, :3]).T, motion.q[:, i, 3], motion.locked[:, i].astype(float)]
    for j in range(k):
        names += [f"cable{j + 1}_top_N", f"cable{j + 1}_motor_N", f"cable{j + 1}_length_m"]
        columns += [motion.tensions_N[:, j], motion.motor_N[:, j], motion.cable_lengths_m[:, j]]
    for i in range(n):
        names += [f"load_{axis}{i + 1}_N" for axis in AXES]
        columns += [*motion.loads_N[:, i].T]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        writer.writerows([f"{value:.9g}" for value in row] for row in np.column_stack(columns).tolist())
    return path


def _write_npz(case: Case, motion: Motion, path: Path) -> Path:
    np.savez_compressed(
        path,
        case=np.array(case.text),
        formulation=np.array(motion.formulation),
        time_s=motion.time_s,
        q=motion.q,
        v=motion.v,
        positions_m=motion.positions_m,
        tilt_rad=motion.tilt_rad,
        tensions_N=motion.tensions_N,
        motor_N=motion.motor_N,
        loads_N=motion.loads_N,
        locked=motion.locked,
        stopped=motion.stopped,
    )
    return path
