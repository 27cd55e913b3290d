"""How finely the 3D view is drawn: in full, or thin for slow links."""

from dataclasses import dataclass

THIN_RINGS = 12
"""Of a whole robot in the thin view: its geometry is the same few kilobytes, however many sections it has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Detail:
    """What is drawn, and how often it is sent."""

    rings: int
    """Along each section of the tube and its tendons. With 16 a bend of 90° is drawn in steps of under 6°."""
    sides: int
    """Of the tube."""
    cap_rings: int
    """That round the tip off."""
    cone_sides: int
    """Of the cone that the tip camera sees."""
    vertebrae: bool
    """Each vertebra, or only the collars between the sections and the head."""
    trail_points: int
    slow_every: int
    """Tension colours and the tip's path take turns on every so many frames."""
    ghost_every: int
    """Frames from one commanded shape to the next."""
    panel_period_s: float
    plot: bool
    """Whether the panels have a live plot."""
    most_Hz: float
    """Frames a second."""


FULL = Detail(
    rings=16,
    sides=16,
    cap_rings=6,
    cone_sides=48,
    vertebrae=True,
    trail_points=100,
    slow_every=3,
    ghost_every=1,
    panel_period_s=0.2,
    plot=True,
    most_Hz=60.0,
)


def rate_of(detail: Detail, wanted_Hz: float) -> float:
    """Frames a second of a view for which somebody chose a rate."""
    return min(wanted_Hz, detail.most_Hz)


def thin(sections: int) -> Detail:
    """For a robot with so many sections: under 60 kB/s."""
    return Detail(
        rings=max(2, round(THIN_RINGS / sections)),
        sides=6,
        cap_rings=3,
        cone_sides=8,
        vertebrae=False,
        trail_points=40,
        slow_every=5,
        ghost_every=5,
        panel_period_s=1.0,
        plot=False,
        most_Hz=10.0,
    )
