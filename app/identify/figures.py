"""Pictures of identified numbers: calibration, load tests (as figure 8 of the SRC-Bot paper), releases, sweeps, friction."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from cobra.mechanics.calibration_report import Knowledge
from cobra.mechanics.estimates import Estimate
from cobra.mechanics.friction import transmission
from cobra.mechanics.identification import SYMBOLS, StiffnessTest, Sweep
from cobra.mechanics.model_selection import Selection
from cobra.mechanics.recordings import Recording
from cobra.mechanics.release import Release
from cobra.mechanics.tables import Floats, Indices

Rows = NDArray[np.bool_]

AXES = "xyz"
MM = 1e3
LEAST_SHOWN = 1e-2
"""Of the singular values; what is under it is as good as zero."""
MOST_NAMES = 12
"""More sets than this are not named in a picture."""
TOLD_COLOR, UNTOLD_COLOR = "tab:blue", "tab:red"


def tip_figure(title: str, recording: Recording, predicted_m: Floats) -> Figure:
    """Measured and predicted tip by sample, and the distance between them."""
    figure = Figure(figsize=(13.0, 8.0), layout="constrained")
    figure.suptitle(title)
    panels = figure.subplots(4, 1, sharex=True, gridspec_kw={"height_ratios": [1, 1, 1, 1.2]})
    sample = np.arange(len(recording))
    for a, panel in enumerate(panels[:3]):
        panel.plot(sample, MM * recording.tip_m[:, a], color="black", lw=1.6, label="measured")
        panel.plot(sample, MM * predicted_m[:, a], color="tab:orange", lw=1.0, label="model")
        panel.set_ylabel(f"tip {AXES[a]} [mm]")
    panels[0].legend(fontsize="small", ncols=2)
    off = MM * np.linalg.norm(predicted_m - recording.tip_m, axis=-1)
    panels[3].plot(sample, off, lw=0.9)
    panels[3].axhline(off.mean(), color="tab:red", ls="--", label=f"mean {off.mean():.2f} mm")
    for start in np.flatnonzero(np.diff(recording.block)) + 1:
        panels[3].axvline(start, color="0.85", lw=0.6, zorder=0)
    panels[3].set_ylabel("tip error [mm]")
    panels[3].set_xlabel("sample (vertical lines: a new motion)")
    panels[3].set_ylim(bottom=0.0)
    panels[3].legend(fontsize="small")
    return figure


def selection_figure(selection: Selection) -> Figure:
    """Held-out tip error of each model that was tried, by fold."""
    figure = Figure(figsize=(10.0, 0.45 * len(selection.trials) + 2.4), layout="constrained")
    panel = figure.subplots()
    names: list[str] = []
    before: tuple[str, ...] = ()
    for trial in selection.trials:
        added = [effect for effect in trial.effects if effect not in before]
        names.append(f"+ {', '.join(added)}" if added else "constant curvature")
        before = trial.effects if trial.kept else before
    place = np.arange(len(names))[::-1]
    colors = [TOLD_COLOR if trial.kept else "0.7" for trial in selection.trials]
    panel.barh(place, [MM * trial.score_m for trial in selection.trials], color=colors, height=0.6)
    for i, fold in enumerate(selection.folds):
        mean = [MM * trial.held_out_m[i] for trial in selection.trials]
        panel.plot(mean, place, ".", ms=4, color="black" if fold.extrapolates else f"C{i + 1}", label=fold.name)
    panel.set_yticks(place, names)
    panel.set_xlabel("mean tip error of motions held out [mm]; blue: kept, grey: not")
    panel.legend(fontsize="x-small")
    return figure


def knowledge_figure(known: Knowledge) -> Figure:
    """How far the data tell each parameter, and the singular values of the weighted Jacobian."""
    count = len(known.parameters)
    figure = Figure(figsize=(12.0, max(0.17 * count, 4.0) + 1.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.4, 1.0])
    place = np.arange(count)[::-1]
    colors = [TOLD_COLOR if p.is_told else UNTOLD_COLOR for p in known.parameters]
    left.barh(place, [p.told for p in known.parameters], color=colors)
    left.set_yticks(place, [p.name for p in known.parameters], fontsize="x-small")
    left.margins(y=0.01)
    left.set_xlabel("uncertainty, as a share of what is usual (red: the data cannot tell)")
    right.semilogy(np.arange(1, len(known.singular_values) + 1), known.singular_values, "o", ms=3)
    right.axhline(1.0, color=UNTOLD_COLOR, ls="--")
    right.set_ylim(bottom=LEAST_SHOWN)
    right.set_xlabel("combination of parameters")
    right.set_ylabel("singular value (under 1: the data cannot tell)")
    return figure


def stiffness_figure(tests: Sequence[tuple[StiffnessTest, Floats, Floats, Indices]]) -> Figure:
    """Load over deflection with the identified line and its 95 % interval, a panel a quantity.

    `tests` hold the result, load, deflection and the index of each point's set.
    """
    figure = Figure(figsize=(5.0 * len(tests), 4.4), layout="constrained")
    panels = figure.subplots(1, len(tests), squeeze=False)[0]
    for panel, (test, load, deflection, group) in zip(panels, tests, strict=True):
        angular = test.quantity != "elongation"
        scale = 180.0 / np.pi if angular else MM
        for i, name in enumerate(test.set_names):
            label = name if 1 < len(test.set_names) <= MOST_NAMES else None
            panel.plot(scale * deflection[group == i], load[group == i], ".", ms=5, label=label)
        ends = np.array([min(deflection.min(), 0.0), max(deflection.max(), 0.0)])
        offset = float(np.mean(test.offsets))
        value, low, high = (offset + slope / test.length_m * ends for slope in test.stiffness)
        panel.plot(scale * ends, value, color="black")
        panel.fill_between(scale * ends, low, high, color="0.8", zorder=0)
        symbol, unit = SYMBOLS[test.quantity]
        half = test.stiffness.high - test.stiffness.value
        panel.set_title(f"{symbol} = {test.stiffness.value:.4g} ± {half:.2g} {unit} (95 %)", fontsize="medium")
        panel.set_xlabel(f"{test.quantity} [{'°' if angular else 'mm'}]")
        panel.set_ylabel("moment [N m]" if angular else "force [N]")
        if 1 < len(test.set_names) <= MOST_NAMES:
            panel.legend(fontsize="xx-small", title="set", title_fontsize="xx-small")
    return figure


def release_figure(time_s: Floats, position: Floats, release: Release, unit: str) -> Figure:
    """Measured and fitted swing, with the band in which friction holds."""
    figure = Figure(figsize=(9.0, 4.4), layout="constrained")
    panel = figure.subplots()
    panel.plot(time_s, position, ".", ms=3, color="black", label="measured")
    panel.plot(time_s, release.fitted, color="tab:orange", label=f"fitted, rms {release.rms:.3g} {unit}")
    low, high = (release.rest.value + side * release.friction.value for side in (-1.0, 1.0))
    panel.axhspan(low, high, color="0.85", zorder=0, label="friction holds")
    panel.set_xlabel("time [s]")
    panel.set_ylabel(f"deflection [{unit}]")
    panel.legend(fontsize="small")
    return figure


def sweep_figure(position: Floats, load: Floats, sweep: Sweep, unit: str, load_unit: str) -> Figure:
    """Load over deflection, going and coming, with the fitted lines."""
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    panel = figure.subplots()
    panel.plot(position[~sweep.used], load[~sweep.used], ".", ms=3, color="0.7", label="turning, not used")
    fitted = (
        sweep.offset.value
        + sweep.stiffness.value * position
        + sweep.damping.value * sweep.speed
        + sweep.friction.value * np.sign(sweep.speed)
    )
    for sign, name, color in ((1.0, "growing", "tab:blue"), (-1.0, "falling", "tab:green")):
        rows = sweep.used & (np.sign(sweep.speed) == sign)
        panel.plot(position[rows], load[rows], ".", ms=3, color=color, label=name)
        order = np.argsort(position[rows])
        panel.plot(position[rows][order], fitted[rows][order], color=color, lw=1.0)
    panel.set_xlabel(f"deflection [{unit}]")
    panel.set_ylabel(f"load [{load_unit}]")
    panel.legend(fontsize="small")
    return figure


def friction_figure(motor_N: Floats, top_N: Floats, angles: Floats, winding: Rows, eta: Estimate) -> Figure:
    """Share of the tension that arrives over the bend, winding in and paying out, with S-36 and S-37 at the found η."""
    figure = Figure(figsize=(7.0, 5.0), layout="constrained")
    panel = figure.subplots()
    bend = np.degrees(np.abs(angles).sum(axis=-1))
    for side, name, color in ((True, "wound in", "tab:blue"), (False, "paid out", "tab:green")):
        rows = winding == side
        low, value, high = (
            transmission(angles[rows], e) ** (1.0 if side else -1.0) for e in (eta.low, eta.value, eta.high)
        )
        panel.plot(bend[rows], top_N[rows] / motor_N[rows], ".", ms=4, color=color, label=f"{name}, measured")
        panel.plot(bend[rows], value, "o", mfc="none", ms=6, color=color, label=f"{name}, fitted")
        panel.vlines(bend[rows], np.minimum(low, high), np.maximum(low, high), color=color, lw=2.0, alpha=0.4)
    panel.set_title(f"η = {eta.value:.4g} ({eta.low:.3g} … {eta.high:.3g}, 95 %)", fontsize="medium")
    panel.set_xlabel("bends of all chambers [°]")
    panel.set_ylabel("tension at the top over that at the motor")
    panel.legend(fontsize="small")
    return figure
