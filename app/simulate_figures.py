"""Pictures of a simulated motion, as the figures 6, 9 and 10 of the SRC-Bot paper show theirs."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.figure import Figure

from cobra.mechanics.cases import Case
from cobra.mechanics.chain import Floats, backbone_frames
from cobra.mechanics.dynamics import Motion
from cobra.mechanics.measured import Measured, difference

SHAPES = 12
"""Postures drawn over the time of a motion."""
DOTS_A_INCH = 130
FLAT_M = 1e-4
"""A motion that leaves the x-z plane by less is drawn in it."""
START, END = "black", "#c45a00"
AXES = "xyz"


def write_figures(case: Case, motion: Motion, measured: Measured | None, folder: Path) -> list[Path]:
    """motion.png (figure 6), trajectories.png (figure 9) and, with an external force, deflection.png (figure 10)."""
    figures = {
        "motion": motion_figure(case, motion, measured),
        "trajectories": trajectory_figure(case, motion, measured),
    }
    if case.load_time_s is not None:
        figures["deflection"] = deflection_figure(case, motion, measured, case.load_time_s)
    paths = []
    for name, figure in figures.items():
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=DOTS_A_INCH)
    return paths


def motion_figure(case: Case, motion: Motion, measured: Measured | None = None) -> Figure:
    """The shape over time, and over it positions and tilts of each guider, cable forces and external forces."""
    sides = _sides(motion)
    rows = len(sides) + len(sides) - 1 + 2
    figure = _figure(case, motion, (13.0, 1.75 * rows))
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.0, 1.35))
    _draw_shapes(figure, grid[:, 0], motion)
    first = None
    colors = _colors(motion.parameters.segments)
    names = [f"{AXES[a]} [mm]" for a in sides] + [f"tilt to {AXES[a]} [°]" for a in sides if a < 2]
    series = [1e3 * motion.positions_m[:, 1:, a] for a in sides]
    series += [np.degrees(motion.tilt_rad[:, 1:, a]) for a in sides if a < 2]
    overlays: list[Floats | None] = [None] * len(series)
    if measured is not None:
        overlays = [1e3 * measured.positions_m[..., a] for a in sides]
        overlays += [np.degrees(measured.tilt_rad[..., a]) for a in sides if a < 2]
    for row, (name, values, overlay) in enumerate(zip(names, series, overlays, strict=True)):
        axes = figure.add_subplot(grid[row, 1], sharex=first)
        first = first or axes
        for i, color in enumerate(colors):
            axes.plot(motion.time_s, values[:, i], color=color, lw=1.2, label=f"guider {i + 1}" if row == 0 else None)
            if measured is not None and overlay is not None:
                axes.plot(measured.time_s, overlay[:, i], ":", color=color, lw=1.4)
        axes.set_ylabel(name)
        axes.tick_params(labelbottom=False)
        if row == 0 and len(colors) <= 8:
            axes.legend(
                ncols=len(colors), fontsize="x-small", loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False
            )
    axes = figure.add_subplot(grid[rows - 2, 1], sharex=first)
    for j in range(motion.tensions_N.shape[1]):
        line = axes.plot(motion.time_s, motion.tensions_N[:, j], lw=1.2, label=f"cable {j + 1}")[0]
        axes.plot(motion.time_s, motion.motor_N[:, j], "--", color=line.get_color(), lw=0.9)
    axes.set_ylabel("top (–), motor (- -) [N]")
    axes.legend(fontsize="x-small", ncols=3)
    axes.tick_params(labelbottom=False)
    axes = figure.add_subplot(grid[rows - 1, 1], sharex=first)
    for i, a in np.argwhere(np.abs(motion.loads_N).max(axis=0) > 0.0):
        axes.plot(motion.time_s, motion.loads_N[:, i, a], color=colors[i], label=f"{AXES[a]}, guider {i + 1}")
        axes.legend(fontsize="x-small")
    axes.set_ylabel("external [N]")
    axes.set_xlabel("time [s]")
    return figure


def trajectory_figure(case: Case, motion: Motion, measured: Measured | None = None) -> Figure:
    """First and last posture with the guiders' paths coloured by time; with a recording, its paths and its error."""
    sides = _sides(motion)
    planes = [(0, 2)] if 1 not in sides else [(0, 2), (1, 2), (0, 1)]
    count = len(planes) + (2 if measured is not None else 1)
    figure = _figure(case, motion, (4.6 * count, 5.0))
    panels = figure.subplots(1, count, squeeze=False)[0]
    ends = 1e3 * backbone_frames(motion.q[[0, -1]])[..., :3, 3]
    points = None
    for axes, (a, b) in zip(panels, planes, strict=False):
        every = slice(None, None, max(len(motion.time_s) // 1500, 1))
        for i in range(1, motion.parameters.segments + 1):
            path = 1e3 * motion.positions_m[every, i]
            points = axes.scatter(
                path[:, a], path[:, b], c=motion.time_s[every], s=2.0, cmap="viridis", rasterized=True
            )
            if measured is not None:
                own = 1e3 * measured.positions_m[:, i - 1]
                axes.plot(own[:, a], own[:, b], ":", color="0.35", lw=1.2, label="measured" if i == 1 else None)
        for shape, frame, color, label in zip(ends, (0, -1), (START, END), ("start", "end"), strict=True):
            axes.plot(shape[:, a], shape[:, b], color=color, lw=2.0, label=label)
            guiders = 1e3 * motion.positions_m[frame]
            axes.plot(guiders[:, a], guiders[:, b], "o", color=color, ms=4.0)
        axes.set_xlabel(f"{AXES[a]} [mm]")
        axes.set_ylabel(f"{AXES[b]} [mm]")
        axes.set_aspect("equal", adjustable="datalim")
        if b == 2 and _hangs(motion):
            axes.invert_yaxis()
        axes.legend(fontsize="small")
    if points is not None:
        figure.colorbar(points, ax=panels[len(planes) - 1], label="time [s]", shrink=0.8)
    colors = _colors(motion.parameters.segments)
    if measured is None:
        for i, color in enumerate(colors):
            panels[-1].plot(
                motion.time_s, _tilt_deg(motion.tilt_rad[:, i + 1], sides), color=color, label=f"guider {i + 1}"
            )
        panels[-1].set_ylabel("bending angle [°]")
    else:
        _draw_errors(panels[-2], panels[-1], motion, measured, colors)
    for axes in panels[len(planes) :]:
        axes.set_xlabel("time [s]")
        if len(colors) <= 8:
            axes.legend(fontsize="x-small")
    return figure


def deflection_figure(case: Case, motion: Motion, measured: Measured | None, loaded_s: float) -> Figure:
    """Posture, positions and bending angles of the guiders before the external force and at the end."""
    sides = _sides(motion)
    figure = _figure(case, motion, (13.0, 5.0))
    left, middle, right = figure.subplots(1, 3)
    before = int(np.searchsorted(motion.time_s, loaded_s))
    number = np.arange(1, motion.parameters.segments + 1)
    # Across which it moves more.
    side = int(np.argmax(np.abs(motion.positions_m[-1, -1, :2] - motion.positions_m[before, -1, :2])))
    for at, color, label in ((before, START, "before the force"), (-1, END, "at the end")):
        shape = 1e3 * backbone_frames(motion.q[at])[:, :3, 3]
        guiders = 1e3 * motion.positions_m[at]
        left.plot(shape[:, side], shape[:, 2], color=color, lw=2.0, label=label)
        left.plot(guiders[:, side], guiders[:, 2], "o", color=color, ms=4.0)
        for a, mark in zip(sides, ("o-", "s-", "^-")[: len(sides)], strict=True):
            middle.plot(number, guiders[1:, a], mark, color=color, ms=4.0, lw=1.0, label=f"{AXES[a]}, {label}")
        right.plot(number, _tilt_deg(motion.tilt_rad[at, 1:], sides), "o-", color=color, ms=4.0, label=label)
    if measured is not None:
        last = int(np.searchsorted(measured.time_s, loaded_s, side="right")) - 1
        for row, color in [(last, START)] * (last >= 0) + [(-1, END)]:
            own = 1e3 * measured.positions_m[row]
            left.plot(own[:, side], own[:, 2], "x", color=color, ms=7.0)
            for a in sides:
                middle.plot(number, own[:, a], "x", color=color, ms=7.0)
            right.plot(number, _tilt_deg(measured.tilt_rad[row], sides), "x", color=color, ms=7.0)
    left.set_xlabel(f"{AXES[side]} [mm]")
    left.set_ylabel("z [mm]")
    left.set_aspect("equal", adjustable="datalim")
    if _hangs(motion):
        left.invert_yaxis()
    middle.set_ylabel("position [mm]")
    right.set_ylabel("bending angle [°]")
    for axes in (middle, right):
        axes.set_xlabel("guider")
        axes.xaxis.get_major_locator().set_params(integer=True)
    for axes in (left, middle, right):
        axes.legend(fontsize="x-small")
    return figure


def _figure(case: Case, motion: Motion, size: tuple[float, float]) -> Figure:
    figure = Figure(figsize=size, layout="constrained")
    form = "" if motion.formulation == "chain" else " (the paper's own equations)"
    figure.suptitle(f"{case.file.title}{form}")
    return figure


def _sides(motion: Motion) -> list[int]:
    """Axes along which something happens: x and z, and y where the motion leaves their plane."""
    return [0, 2] if np.abs(motion.positions_m[..., 1]).max() < FLAT_M else [0, 1, 2]


def _hangs(motion: Motion) -> bool:
    """Then what points down is drawn down."""
    return motion.parameters.gravity_m_s2[2] > 0.0


def _tilt_deg(tilt: Floats, sides: list[int]) -> Floats:
    """Signed in the plane, else the whole angle."""
    return np.degrees(tilt[..., 0] if 1 not in sides else np.linalg.norm(tilt, axis=-1))


def _colors(count: int) -> list[Any]:
    return [colormaps["plasma"](0.88 * i / max(count - 1, 1)) for i in range(count)]


def _draw_shapes(figure: Figure, place: Any, motion: Motion) -> None:
    """Postures at even times, in the x-z plane or in space."""
    spatial = 1 in _sides(motion)
    axes: Any = figure.add_subplot(place, projection="3d" if spatial else None)
    picked = np.unique(np.linspace(0, len(motion.time_s) - 1, SHAPES).astype(int))
    shapes = 1e3 * backbone_frames(motion.q[picked])[..., :3, 3]
    for shape, row in zip(shapes, picked, strict=True):
        color = colormaps["viridis"](motion.time_s[row] / motion.time_s[-1])
        guiders = 1e3 * motion.positions_m[row]
        use = [0, 1, 2] if spatial else [0, 2]
        axes.plot(*shape[:, use].T, color=color, lw=1.6, label=f"{motion.time_s[row]:.1f} s")
        axes.plot(*guiders[:, use].T, "o", color=color, ms=3.5)
    axes.set_xlabel("x [mm]")
    if spatial:
        axes.set_ylabel("y [mm]")
        axes.set_zlabel("z [mm]")
        axes.set_aspect("equal", adjustable="datalim")
    else:
        axes.set_ylabel("z [mm]")
        axes.set_aspect("equal", adjustable="datalim")
    if _hangs(motion):
        (axes.invert_zaxis if spatial else axes.invert_yaxis)()
    axes.legend(fontsize="x-small", ncols=2)


def _draw_errors(left: Any, right: Any, motion: Motion, measured: Measured, colors: list[Any]) -> None:
    error = difference(motion, measured)
    for i, color in enumerate(colors):
        distance = 1e3 * np.sqrt(np.nansum(error.positions_m[:, i] ** 2, axis=-1))
        if not np.isnan(error.positions_m[:, i]).all():
            left.plot(error.time_s, distance, color=color, label=f"guider {i + 1}")
        if not np.isnan(error.tilt_rad[:, i]).all():
            angle = np.degrees(np.sqrt(np.nansum(error.tilt_rad[:, i] ** 2, axis=-1)))
            right.plot(error.time_s, angle, color=color, label=f"guider {i + 1}")
    left.set_ylabel("position, measured against simulated [mm]")
    right.set_ylabel("tilt, measured against simulated [°]")
