"""The configuration q of a robot: which variable stands where, its unit, its rest value and its limits.

q = [twist rad, feed m, then per section b_x, b_y rad and, only where the section can elongate, its length m].
Twist and feed are always there; without such a drive they are constants, or a length fed in by hand.
"""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cobra.description import RobotDescription

Floats = NDArray[np.float64]

TWIST = 0
"""Index of the twist φ₀ in q."""
FEED = 1
"""Index of the feed ℓ₀ in q."""


@dataclass(frozen=True)
class Configuration:
    """The layout of q for one robot (MODEL: q = [φ₀, ℓ₀, b₁, …, bₙ], with Lᵢ after bᵢ where section i elongates)."""

    description: RobotDescription

    @cached_property
    def bends(self) -> tuple[slice, ...]:
        """For each section where its bend vector (b_x, b_y) stands in q."""
        return tuple(slice(int(x), int(x) + 2) for x in self._first)

    @cached_property
    def lengths(self) -> tuple[int | None, ...]:
        """For each section where its length stands in q, or None when its length is constant."""
        return tuple(
            int(x) + 2 if s.elongation else None for x, s in zip(self._first, self.description.sections, strict=True)
        )

    @cached_property
    def size(self) -> int:
        """Number of entries of q."""
        return 2 + sum(3 if section.elongation else 2 for section in self.description.sections)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the entries of q, for people: "twist", "feed", "tip x", "tip y", "tip length"."""
        out = ["twist", "feed"]
        for section in self.description.sections:
            out += [f"{section.name} {part}" for part in ("x", "y", *(("length",) if section.elongation else ()))]
        return tuple(out)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the entries of q: "rad" or "m"."""
        metres = {FEED, *(i for i in self.lengths if i is not None)}
        return tuple("m" if i in metres else "rad" for i in range(self.size))

    @cached_property
    def actuated(self) -> tuple[int, ...]:
        """Indices of the entries of q that the robot's own drives move."""
        return tuple(int(i) for i in np.flatnonzero(self.rate))

    @cached_property
    def low(self) -> Floats:
        """Lowest values of q (size,). The bends' is a box around the true limit |b_i| ≤ κ_max,i ℓ_e,i (`Backbone`)."""
        return _fixed(self._limits[0])

    @cached_property
    def high(self) -> Floats:
        """Highest values of q (size,), as `low`."""
        return _fixed(self._limits[1])

    @cached_property
    def rate(self) -> Floats:
        """Largest rates (size,) [rad/s, m/s]; 0 where no drive moves the entry. A bend's holds for the vector's norm."""
        return _fixed(self._rates[0])

    @cached_property
    def acceleration(self) -> Floats:
        """Largest accelerations (size,) [rad/s², m/s²]; 0 where no drive moves the entry."""
        return _fixed(self._rates[1])

    def rest(self) -> Floats:
        """The configuration at the start (size,): straight, not twisted, every section at its own length.

        The feed is `feed.start_m`, or the length of the active segment when no drive feeds.
        """
        q = np.zeros(self.size)
        feed = self.description.feed
        q[FEED] = feed.start_m if feed else self.description.active_length_m
        for section, index in zip(self.description.sections, self.lengths, strict=True):
            if index is not None:
                q[index] = section.length_m
        return q

    def home(self) -> Floats:
        """The configuration after homing (size,): as `rest`, but with every tendon at its pretension, which shortens
        the sections that can: by tension over stiffness a chamber (S-38)."""
        d, q = self.description, self.rest()
        for i, (section, index) in enumerate(zip(d.sections, self.lengths, strict=True)):
            if section.elongation and index is not None and d.tendon:
                pull = d.tendon.pretension_N * sum(end >= i for end in d.tendon_section)
                q[index] -= section.vertebrae * pull / section.elongation.stiffness_N_m
        return q

    def section_lengths(self, q: Floats) -> Floats:
        """Lengths of the sections (..., n) at q (..., size) [m]."""
        out = np.empty((*q.shape[:-1], len(self.bends)))
        for i, (section, index) in enumerate(zip(self.description.sections, self.lengths, strict=True)):
            out[..., i] = section.length_m if index is None else q[..., index]
        return out

    @cached_property
    def _first(self) -> tuple[int, ...]:
        widths = [3 if section.elongation else 2 for section in self.description.sections]
        return tuple(2 + sum(widths[:i]) for i in range(len(widths)))

    @cached_property
    def _limits(self) -> tuple[Floats, Floats]:
        d = self.description
        low, high = np.zeros(self.size), np.zeros(self.size)
        low[TWIST], high[TWIST] = d.twist.range_rad if d.twist else (0.0, 0.0)
        low[FEED], high[FEED] = d.feed.range_m if d.feed else (0.0, d.backbone.total_length_m)
        for section, bend, index in zip(d.sections, self.bends, self.lengths, strict=True):
            longest = section.elongation.range_m[1] if section.elongation else section.length_m
            low[bend], high[bend] = -section.max_curvature_1_m * longest, section.max_curvature_1_m * longest
            if section.elongation and index is not None:
                low[index], high[index] = section.elongation.range_m
        return low, high

    @cached_property
    def _rates(self) -> tuple[Floats, Floats]:
        d = self.description
        rate, acceleration = np.zeros(self.size), np.zeros(self.size)
        if d.twist:
            rate[TWIST] = math.radians(d.twist.rate_deg_s)
            acceleration[TWIST] = math.radians(d.twist.acceleration_deg_s2)
        if d.feed:
            rate[FEED], acceleration[FEED] = d.feed.rate_m_s, d.feed.acceleration_m_s2
        for section, bend, index in zip(d.sections, self.bends, self.lengths, strict=True):
            if not section.active:
                continue
            rate[bend] = math.radians(d.teleop.bend_rate_deg_s)
            acceleration[bend] = math.radians(d.teleop.bend_acceleration_deg_s2)
            if section.elongation and index is not None:
                rate[index] = section.elongation.rate_m_s
                acceleration[index] = section.elongation.acceleration_m_s2
        return rate, acceleration


def _fixed(values: Floats) -> Floats:
    values.flags.writeable = False
    return values
