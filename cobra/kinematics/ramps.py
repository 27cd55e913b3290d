"""Speeds from which a motion can still stop in time, and vectors kept within a length."""

import math

from cobra.kinematics.configuration import Floats


def braking_speed(distance: float, acceleration: float, dt_s: float) -> float:
    """Largest speed v from which steps of `dt_s` come to rest within `distance`: v dt + (v − a dt) dt + … ≤ distance.

    In N steps, N(N − 1)/2 a dt² < distance ≤ N(N + 1)/2 a dt²:  v = distance/(N dt) + (N − 1)/2 a dt. It is exact: the
    speed allowed after such a step is never below v − a dt.
    """
    if distance <= 0.0:
        return 0.0
    step = acceleration * dt_s
    steps = math.ceil((math.sqrt(1.0 + 8.0 * distance / (step * dt_s)) - 1.0) / 2.0 - 1e-9)
    steps = max(steps, 1)
    return distance / (steps * dt_s) + 0.5 * (steps - 1) * step


def shortened(vector: Floats, length: float) -> Floats:
    """The plane vector (2,), no longer than `length`."""
    size = math.hypot(vector[0], vector[1])
    return vector if size <= length else vector * (length / size)


def approached(value: float, wanted: float, step: float) -> float:
    """`value` moved towards `wanted` by at most `step`."""
    return value + min(max(wanted - value, -step), step)


def reached(start: Floats, end: Floats, centre: Floats, radius: float) -> Floats:
    """The last point of the segment from `start` to `end` (2,) that lies in the disc; `start` must lie in it."""
    way, out = end - start, start - centre
    a, b, c = float(way @ way), float(way @ out), float(out @ out) - radius * radius
    if a == 0.0 or a + 2.0 * b + c <= 0.0:
        return end
    return start + way * max((math.sqrt(max(b * b - a * c, 0.0)) - b) / a, 0.0)
