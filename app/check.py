"""A robot description in words: degrees of freedom, tendons, reach, bus load, and what is assumed."""

from collections.abc import Iterator
from pathlib import Path

import msgspec
import numpy as np

from app.console.guides import guides
from cobra.description import RobotDescription
from cobra.kinematics.configuration import Configuration
from cobra.kinematics.workspace import reachable_tips
from cobra.loading import assumed_numbers
from cobra.mechanics.losses import load
from cobra.motors.bus_load import channel_load

REACH_SHAPES = 20_000


def explain(description: RobotDescription) -> Iterator[str]:
    """Lines for people.

    Raises:
        LossesError: the loss parameters that it names cannot be used.
    """
    d = description
    yield f"{d.title}: {d.summary}" if d.summary else d.title
    bends = 2 * len(d.active_sections)
    lengths = sum(1 for i in d.active_sections if d.sections[i].elongation)
    parts = [f"{bends} of bending"] if bends else []
    parts += [f"{lengths} of length"] if lengths else []
    parts += [word for word, part in (("twist", d.twist), ("feed", d.feed)) if part]
    total = bends + lengths + bool(d.twist) + bool(d.feed)
    yield f"Degrees of freedom: {total} ({', '.join(parts)})."
    yield f"Modes of motion: {', '.join(guide.title for guide in guides(d))}."
    for section in d.sections:
        kind = (
            f"{len(section.routing.names)} tendons ({', '.join(section.routing.names)})"
            if section.routing
            else "passive"
        )
        yield (
            f"Section {section.name}: {section.length_m * 1e3:.0f} mm, bends up to {section.max_bend_deg:.0f} degrees "
            f"(radius {section.length_m / section.max_bend_rad * 1e3:.0f} mm), {kind}."
        )
    yield f"Active segment: {d.active_length_m * 1e3:.0f} mm of {d.backbone.total_length_m:g} m, {d.backbone.diameter_m * 1e3:g} mm thin."
    if d.hand_fed:
        yield "Feed: by hand; the exposed length is told in the page or by a measuring device."
    if d.feed:
        yield f"Feed: {d.feed.range_m[0] * 1e3:.0f} to {d.feed.range_m[1] * 1e3:.0f} mm beyond the port, starts at {d.feed.start_m * 1e3:.0f} mm."
    if d.twist:
        yield f"Twist: {d.twist.range_deg[0]:.0f} to {d.twist.range_deg[1]:.0f} degrees."
    yield _reach(d)
    for bus in d.buses:
        drives = [drive for drive in d.drives if drive.bus == bus.name]
        protocols = sorted({d.motor_of(drive).protocol for drive in drives})
        yield (
            f"Bus {bus.name}: {bus.interface} {bus.channel}, {bus.bitrate // 1000} kbit/s, {len(drives)} drives "
            f"({', '.join(protocols)}), {channel_load(d, bus).load:.0%} busy at {d.teleop.loop_rate_Hz:.0f} Hz."
        )
    if d.compensation and d.compensation.parameters:
        yield f"Compensation: numbers from {load(Path(d.compensation.parameters), d).source} ({d.compensation.parameters})."
    assumed = assumed_numbers(d)
    count = sum(1 for _ in msgspec.to_builtins(d.provenance.given))
    if count:
        yield f"{len(assumed)} numbers are assumed, {count} come from a source ({d.provenance.source})."


def _reach(d: RobotDescription) -> str:
    """How far the tip gets, from a cloud of shapes inside every limit."""
    layout = Configuration(d)
    bends = {i for bend in layout.bends for i in (bend.start, bend.start + 1)}
    driven = tuple(index for index in layout.actuated if index not in bends)
    tips = reachable_tips(d, layout.home(), d.active_sections, driven, REACH_SHAPES)
    aside, ahead = np.hypot(tips[:, 0], tips[:, 1]).max(), tips[:, 2].max()
    return f"Reach of the tip, from {REACH_SHAPES} shapes: {aside * 1e3:.0f} mm aside, {ahead * 1e3:.0f} mm ahead of the port."
