"""Plots of a recording: bends, twist and feed, tensions, the tip's path and the loop's timing over time."""

from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from app.recording.container import RecordingError
from app.recording.reader import Recording
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration

Floats = NDArray[np.float64]
MOST_POINTS: Final = 4000
LEVEL_COLORS: Final = {"alarm": "#c2201b", "warning": "#c98a00", "marker": "#1485ad"}


class Curves(NamedTuple):
    """What is drawn, sampled evenly."""

    time_s: Floats
    measured: Floats
    """(times, size of q)"""
    commanded: Floats
    tension_N: Floats
    """(times, tendons)"""
    tip_m: Floats
    """(times, 3)"""
    period_p99_s: Floats


def sample(recording: Recording) -> Curves:
    """At most `MOST_POINTS` states over the whole recording.

    Raises:
        RecordingError: the robot's description is not known.
    """
    description = recording.description
    if description is None:
        raise RecordingError(f"{recording.path.name}: without the robot's description there is nothing to plot")
    size, backbone = Configuration(description).size, Backbone(description)
    count = int(min(max(recording.duration_s * 20.0, 2), MOST_POINTS))
    time_s = np.linspace(0.0, recording.duration_s, count)
    measured, commanded = np.full((count, size), np.nan), np.full((count, size), np.nan)
    tension, tip = np.full((count, len(description.tendon_names)), np.nan), np.full((count, 3), np.nan)
    period = np.full(count, np.nan)
    for i, t in enumerate(time_s):
        state = recording.state_at(float(t))
        if state is None:
            continue
        period[i] = state.timing.period_p99 or np.nan
        if len(state.drives.load) == len(description.drives):
            tension[i] = np.array(state.drives.load)[list(description.tendon_drives)]
        if state.homed and len(state.measured) == len(state.commanded) == size:
            measured[i], commanded[i] = state.measured, state.commanded
            if np.isfinite(measured[i]).all():
                tip[i] = backbone.tip(measured[i])[:3, 3]
    return Curves(time_s, measured, commanded, tension, tip, period)


def write(recording: Recording, folder: Path) -> list[Path]:
    """One PNG each: shape.png, tensions.png where there are tendons, tip.png, timing.png."""
    curves = sample(recording)
    paths = []
    for name, figure in figures(recording, curves).items():
        path = folder / f"{name}.png"
        figure.savefig(path, dpi=130)
        paths.append(path)
    return paths


def figures(recording: Recording, curves: Curves) -> dict[str, Figure]:
    """The plots by name."""
    tensions = {"tensions": _tensions(recording, curves)} if curves.tension_N.size else {}
    return {
        "shape": _shape(recording, curves),
        **tensions,
        "tip": _tip(curves),
        "timing": _timing(recording, curves),
    }


def _shape(recording: Recording, curves: Curves) -> Figure:
    description = recording.description
    assert description is not None
    layout = Configuration(description)
    figure = Figure(figsize=(9, 6), layout="constrained")
    bends, rest = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    for section, where in zip(description.sections, layout.bends, strict=True):
        (line,) = bends.plot(curves.time_s, _degrees(curves.measured, where), label=f"{section.name}, measured")
        bends.plot(curves.time_s, _degrees(curves.commanded, where), "--", color=line.get_color(), linewidth=0.8)
    bends.set_ylabel("bend [°]   (dashed: commanded)")
    if description.sections:
        bends.legend(loc="upper right")
    rest.plot(curves.time_s, np.degrees(curves.measured[:, TWIST]), label="twist [°]")
    rest.plot(curves.time_s, 1e3 * curves.measured[:, FEED], label="feed [mm]")
    rest.legend(loc="upper right")
    rest.set_xlabel("time [s]")
    _mark_events(recording, bends, rest)
    return figure


def _tensions(recording: Recording, curves: Curves) -> Figure:
    description = recording.description
    assert description is not None
    figure = Figure(figsize=(9, 4), layout="constrained")
    axes = figure.subplots()
    for name, tension in zip(description.tendon_names, curves.tension_N.T, strict=True):
        axes.plot(curves.time_s, tension, linewidth=1.0, label=name)
    if description.tendon is not None:
        axes.axhline(description.tendon.max_tension_N, color="#c2201b", linestyle=":", label="limit")
    axes.set_xlabel("time [s]")
    axes.set_ylabel("tension [N]")
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small")
    _mark_events(recording, axes)
    return figure


def _tip(curves: Curves) -> Figure:
    figure = Figure(figsize=(9, 4), layout="constrained")
    front, side = figure.subplots(1, 2)
    x, y, z = 1e3 * curves.tip_m.T
    for axes, across, words in (
        (front, x, ("x, right [mm]", "seen from behind")),
        (side, z, ("z, ahead [mm]", "side")),
    ):
        axes.plot(across, y, linewidth=1.0)
        axes.set_xlabel(words[0])
        axes.set_ylabel("y, down [mm]")
        axes.set_title(f"path of the tip, {words[1]}", fontsize="medium")
        axes.invert_yaxis()
        axes.set_aspect("equal", adjustable="datalim")
    return figure


def _timing(recording: Recording, curves: Curves) -> Figure:
    figure = Figure(figsize=(9, 2.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(curves.time_s, 1e3 * curves.period_p99_s)
    axes.set_xlabel("time [s]")
    axes.set_ylabel("loop period,\n99 % under [ms]")
    axes.set_ylim(bottom=0.0)
    _mark_events(recording, axes)
    return figure


def _mark_events(recording: Recording, *rows: Axes) -> None:
    for event in recording.digest.events:
        color = LEVEL_COLORS.get(event.level)
        if color:
            for axes in rows:
                axes.axvline(event.time_s, color=color, linewidth=0.8, alpha=0.7)


def _degrees(q: Floats, where: slice) -> Floats:
    return np.degrees(np.hypot(*q[:, where].T))
