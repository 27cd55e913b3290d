"""The live plot: the last seconds of tensions, bends or following errors, sampled slowly enough to be read."""

from dataclasses import dataclass

import numpy as np
import viser
from viser import uplot

from app.console.appearance import SERIES_COLORS, hex_color
from app.console.meshes import Floats
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.messages import RobotState

POINTS = 200
SAMPLE_S = 0.1
TENSION = "tension [N]"
BEND = "measured bend [°]"
ERROR = "setpoint less travel [mm]"


@dataclass(frozen=True, slots=True)
class Channel:
    """One choice of the plot."""

    title: str
    names: tuple[str, ...]


class History:
    """The last `POINTS` samples of every channel, oldest first."""

    def __init__(self, description: RobotDescription) -> None:
        self._description = description
        self._configuration = Configuration(description)
        self._count = 0
        bends = tuple(f"{section.name} {axis}" for section in description.sections for axis in "xy")
        lengths = tuple(drive.name for drive in description.drives if drive.moves != "twist")
        channels = (Channel(TENSION, description.tendon_names), Channel(BEND, bends), Channel(ERROR, lengths))
        self.channels = tuple(channel for channel in channels if channel.names)
        self._samples = {channel.title: np.zeros((POINTS, len(channel.names))) for channel in self.channels}

    def forget(self) -> None:
        """Begin anew."""
        self._count = 0
        for samples in self._samples.values():
            samples[:] = 0.0

    def add(self, state: RobotState) -> None:
        """Append a sample. The state's lists must match the description. What is not known keeps its last value."""
        drives, description = state.drives, self._description
        measured = np.array(state.measured or self._configuration.rest())
        values = {
            TENSION: [drives.load[i] for i in description.tendon_drives],
            BEND: np.degrees(np.concatenate([measured[bend] for bend in self._configuration.bends])),
            ERROR: [
                1e3 * (setpoint - travel)
                for drive, setpoint, travel in zip(description.drives, drives.setpoint, drives.travel, strict=True)
                if drive.moves != "twist"
            ],
        }
        self._count = min(self._count + 1, POINTS)
        for title, samples in self._samples.items():
            newest = np.asarray(values[title], dtype=float)
            samples[:-1] = samples[1:]
            samples[-1] = np.where(np.isfinite(newest), newest, samples[-2])

    def data(self, channel: Channel) -> tuple[Floats, ...]:
        """Seconds before the newest sample, and the samples of each name: arrays of equal length, at most `POINTS`."""
        count = max(self._count, 2)
        time = SAMPLE_S * np.arange(1 - count, 1)
        return (time, *np.ascontiguousarray(self._samples[channel.title][-count:].T))


def add_plot(gui: viser.GuiApi, history: History, channel: Channel) -> viser.GuiUplotHandle:
    """A plot of one channel with a legend that can switch its lines."""
    lines = [
        uplot.Series(label=name, stroke=hex_color(SERIES_COLORS[i % len(SERIES_COLORS)]), width=1.5)
        for i, name in enumerate(channel.names)
    ]
    return gui.add_uplot(
        data=history.data(channel),
        series=(uplot.Series(label="s"), *lines),
        # The x axis would be a date otherwise.
        scales={"x": uplot.Scale(time=False, range=(-POINTS * SAMPLE_S, 0.0))},
        axes=(uplot.Axis(label="seconds", size=34, labelSize=18), uplot.Axis(label=channel.title, size=40)),
        legend=uplot.Legend(show=True, live=False),
        height=230,
    )
