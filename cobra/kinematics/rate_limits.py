"""What the rates of q may be, so that every limit holds now and can still be kept: a polytope a tick.

From any rates u the robot can brake: each bend along a straight line, u(1 − 1/N), u(1 − 2/N), … 0, in as many ticks N as
it needs, and so twist, feed and lengths. It comes to rest at q + u τ, τ = (N + 1)/2 dt. Limits of place are asked of that
end. Accelerations are exceeded only where the port straightens a section, and where a tendon ends its travel.
"""

import math
from typing import NamedTuple

import numpy as np

from cobra.description import RobotDescription
from cobra.kinematics.backbone import Backbone
from cobra.kinematics.configuration import FEED, TWIST, Configuration, Floats
from cobra.kinematics.ramps import braking_speed
from cobra.kinematics.tendons import TendonMap

SIDES = 16
"""Rate and acceleration of a bend are kept in a polygon of so many sides inside the disc."""
APPROACH = 0.5
"""Share of a bend's acceleration with which it approaches its limit; the rest is for what bends the approach."""
STRAIGHT_RAD = 1e-4
"""A bend so small does not keep its section from sliding into the port."""
_APOTHEM = math.cos(math.pi / SIDES)
_HALF = np.array([[math.cos(a), math.sin(a)] for a in 2.0 * math.pi / SIDES * np.arange(SIDES // 2)])
_AROUND = np.array([[math.cos(a), math.sin(a)] for a in math.pi / 4 * np.arange(8)])


class Bounds(NamedTuple):
    """low ≤ [I; rows] u ≤ high for the rates u (m,) of the entries of q that drives move.

    The rows from `places` on are limits of place: where the last rates leave no step that keeps them all, they give way
    as little as possible. Those before, rates and accelerations, never do.
    """

    rows: Floats
    """(k, m)"""
    low: Floats
    """(m + k,)"""
    high: Floats
    """(m + k,)"""
    braking: Floats
    """(m,) the rates that brake; always within rates and accelerations."""
    places: int

    def share(self, rates: Floats) -> float:
        """The largest share of the way from braking to `rates` that stays within, 0…1."""
        start = np.concatenate([self.braking, self.rows @ self.braking])
        way = np.concatenate([rates, self.rows @ rates]) - start
        moves = np.abs(way) > 1e-12
        room = np.where(way > 0.0, self.high - start, self.low - start)[moves] / way[moves]
        return float(np.clip(np.min(room, initial=1.0), 0.0, 1.0))


class RateLimits:
    """The limits of one robot: bends, rates and accelerations, twist and feed, and the tendons' travel and speed."""

    def __init__(self, description: RobotDescription) -> None:
        self._description = description
        self.layout = layout = Configuration(description)
        self.moves = np.array(layout.actuated, dtype=np.int64)
        """Entries of q that drives move (m,)."""
        self._backbone = Backbone(description)
        self._tendons = TendonMap(description)
        local = {int(index): k for k, index in enumerate(self.moves)}
        self._sections = description.active_sections
        self._columns = [local[layout.bends[i].start] for i in self._sections]
        self._scalars = np.array([k for k in local.values() if not {k, k - 1} & set(self._columns)], dtype=np.int64)
        self.low, self.high, self._rate = layout.low.copy(), layout.high.copy(), layout.rate.copy()
        for index, drive_index in ((TWIST, description.twist_drive), (FEED, description.feed_drive)):
            if drive_index is not None:
                drive = description.drives[drive_index]
                speed = description.motor_of(drive).max_speed_rad_s * abs(drive.travel_per_rad)
                self.low[index] = max(self.low[index], drive.travel_limits[0])
                self.high[index] = min(self.high[index], drive.travel_limits[1])
                self._rate[index] = min(self._rate[index], speed)
        self._slowest = self._rate.copy()
        """Largest rates downwards: the port takes κ_max times the feed rate off a bend, no faster than it may unbend."""
        for i in self._sections:
            unbending = layout.rate[layout.bends[i].start] / self._backbone.max_curvature_1_m[i]
            self._slowest[FEED] = min(self._slowest[FEED], unbending)
        drives = [description.drives[i] for i in description.tendon_drives]
        self.tendon_low = np.array([drive.travel_limits[0] for drive in drives])
        self.tendon_high = np.array([drive.travel_limits[1] for drive in drives])
        self._tendon_speed = np.array([description.motor_of(d).max_speed_rad_s * abs(d.travel_per_rad) for d in drives])
        self._tendon_rows = self._tendons.matrix[:, self.moves].copy()
        self._polygons = np.zeros((len(_HALF) * len(self._columns), len(self.moves)))
        for k, column in enumerate(self._columns):
            self._polygons[len(_HALF) * k : len(_HALF) * (k + 1), column : column + 2] = _HALF
        self._coupling, self._growth = self._exposure_slopes(local)

    def bounds(self, q: Floats, velocity: Floats, dt_s: float) -> Bounds:
        """The polytope of this tick at q (size,) with the last tick's rates (size,)."""
        v = velocity[self.moves]
        ticks = self._braking_ticks(v, dt_s)
        braking = v * (1.0 - 1.0 / ticks)
        braking[self._scalars] = np.sign(v[self._scalars]) * np.maximum(
            np.abs(v[self._scalars]) - self.layout.acceleration[self.moves][self._scalars] * dt_s, 0.0
        )
        # The step may be faster than the last by one tick's acceleration, and then brakes for up to two ticks longer.
        horizon_s = 0.5 * (ticks + 3.0) * dt_s
        low, high = self._boxes(q, v, dt_s)
        bend_rows, approach = self._bend_rows(q, v, horizon_s, dt_s)
        polygon_low, polygon_high = self._polygon_bounds(v, dt_s)
        now = self._tendons.lengths(q)
        # What takes a tendon away from its end may stop first: it counts for this tick only.
        speeds = self._tendon_rows * v
        nearing = np.maximum(self.tendon_high - now, 0.0) < np.maximum(now - self.tendon_low, 0.0)
        helps = np.where(nearing[:, None], speeds < 0.0, speeds > 0.0)
        stops = self._tendon_rows * np.where(helps, dt_s, horizon_s)
        rows = np.concatenate([self._polygons, self._tendon_rows, stops, bend_rows])
        low = np.concatenate(
            [
                low,
                polygon_low,
                -self._tendon_speed,
                np.minimum(self.tendon_low - now, 0.0),
                np.full(len(approach), -np.inf),
            ]
        )
        high = np.concatenate(
            [high, polygon_high, self._tendon_speed, np.maximum(self.tendon_high - now, 0.0), approach]
        )
        places = len(self._polygons) + len(self._tendon_rows)
        always = np.concatenate([braking, rows[:places] @ braking])
        end = len(always)
        low[:end], high[:end] = np.minimum(low[:end], always), np.maximum(high[:end], always)
        return Bounds(rows, low, high, braking, places)

    def words(self, q: Floats) -> tuple[str, ...]:
        """Which limits of place q has reached, in words."""
        out = []
        for index, name in ((TWIST, "twist"), (FEED, "feed")):
            if self._rate[index] > 0.0 and min(q[index] - self.low[index], self.high[index] - q[index]) < 1e-3:
                out.append(f"the {name} is at the end of its range")
        limits = self._backbone.bend_limits(q)
        for i in self._sections:
            if float(np.hypot(*q[self.layout.bends[i]])) > 0.99 * limits[i]:
                out.append(f"section {self._description.sections[i].name} is bent as far as it may")
        room = self._tendons.lengths(q)
        ends = np.minimum(room - self.tendon_low, self.tendon_high - room) < 1e-4
        out += [f"tendon {self._description.tendon_names[j]} is at the end of its travel" for j in np.flatnonzero(ends)]
        return tuple(out)

    def _braking_ticks(self, v: Floats, dt_s: float) -> Floats:
        """N (m,) for every entry: a bend's acceleration is kept in the polygon, so that braking is in it."""
        acceleration = self.layout.acceleration[self.moves]
        seconds = np.abs(v) / acceleration
        for column in self._columns:
            speed = math.hypot(v[column], v[column + 1])
            seconds[column : column + 2] = speed / (acceleration[column] * _APOTHEM)
        return np.maximum(np.ceil(seconds / dt_s - 1e-9), 1.0)

    def _boxes(self, q: Floats, v: Floats, dt_s: float) -> tuple[Floats, Floats]:
        high, low = self._rate[self.moves].copy(), -self._slowest[self.moves]
        for k in self._scalars:
            index = self.moves[k]
            acceleration = self.layout.acceleration[index]
            up = braking_speed(self.high[index] - q[index], acceleration, dt_s)
            down = braking_speed(q[index] - self.low[index], acceleration, dt_s)
            high[k] = min(high[k], v[k] + acceleration * dt_s, up)
            low[k] = max(low[k], v[k] - acceleration * dt_s, -down)
        return low, high

    def _polygon_bounds(self, v: Floats, dt_s: float) -> tuple[Floats, Floats]:
        """Rate and acceleration of each bend: two facing sides a row."""
        along = self._polygons @ v
        columns = np.repeat(self._columns, len(_HALF)).astype(np.int64)
        rate = self._rate[self.moves][columns] * _APOTHEM
        change = self.layout.acceleration[self.moves][columns] * dt_s * _APOTHEM
        return np.maximum(-rate, along - change), np.minimum(rate, along + change)

    def _bend_rows(self, q: Floats, v: Floats, horizon_s: Floats, dt_s: float) -> tuple[Floats, Floats]:
        """|b_i| ≤ κ_max,i ℓ_e,i: sides of an octagon that faces the bend which v leads to.

        Towards each side no faster than the bend can stop there. ℓ_e is the lesser of the whole section and what is
        beyond the port; so the feed waits for a bent section to straighten before it vanishes, and a straight one
        lets it pass.
        """
        lengths = self.layout.section_lengths(q)
        outside = np.cumsum(lengths) + q[FEED] - self._backbone.active_length_m
        rows, speeds = [np.zeros((0, len(self.moves)))], [np.zeros(0)]
        for i, column in zip(self._sections, self._columns, strict=True):
            curvature = self._backbone.max_curvature_1_m[i]
            bend = q[self.layout.bends[i]]
            there = bend + v[column : column + 2] * horizon_s[column : column + 2]
            size = math.hypot(there[0], there[1])
            c, s = there / size if size > 1e-9 else (1.0, 0.0)
            normals = _AROUND @ np.array([[c, s], [-s, c]])
            acceleration = APPROACH * self.layout.acceleration[self.layout.bends[i].start]
            travel = float(self._coupling[i] * horizon_s @ v)
            near = abs(travel) + 1e-3
            sides = np.zeros((len(normals), len(self.moves)))
            sides[:, column : column + 2] = normals
            found = []
            if outside[i] <= 0.0 or (outside[i] + travel <= near and math.hypot(bend[0], bend[1]) <= STRAIGHT_RAD):
                found.append((sides, 0.0))
            else:
                if outside[i] <= lengths[i] + near:
                    found.append((sides - curvature * self._coupling[i], outside[i]))
                if outside[i] >= lengths[i] - near:
                    found.append((sides - curvature * self._growth[i], lengths[i]))
            for side, exposed in found:
                room = curvature * exposed - normals @ bend
                rows.append(side)
                speeds.append(np.array([math.copysign(braking_speed(abs(r), acceleration, dt_s), r) for r in room]))
        return np.concatenate(rows), np.concatenate(speeds)

    def _exposure_slopes(self, local: dict[int, int]) -> tuple[Floats, Floats]:
        """(n, m) each: how every section grows with each rate: what is beyond the port, and the whole."""
        beyond, whole = (np.zeros((len(self.layout.bends), len(self.moves))) for _ in range(2))
        if FEED in local:
            beyond[:, local[FEED]] = 1.0
        for k, index in enumerate(self.layout.lengths):
            if index in local:
                beyond[k:, local[index]] = 1.0
                whole[k, local[index]] = 1.0
        return beyond, whole
