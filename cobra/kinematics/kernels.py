"""The kernels that numba compiles for the control loop: a tick's kinematics, and the fit of the backbone to a path.

Same results as the NumPy reference (`section.py`, `backbone.py`, `tendons.py`), which stays as the tests' oracle.
All kernels stand in one file, because numba's cache on disk sees a change only in the file of the function it caches.
Shapes: n sections; q (size,); layout (n, 2) int64 with where b_x and the length (or −1) stand in q; path (≥ 2, 3).
"""

from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from cobra.kinematics.backbone import EXPOSURE_TOLERANCE_M
from cobra.kinematics.section import SERIES_BELOW


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile at the first call; kept on disk where there is a writable place for it."""
    try:
        return numba.njit(cache=True, fastmath=False)(function)
    except RuntimeError:  # numba: "no locator available", a read-only installation without a cache folder
        return numba.njit(fastmath=False)(function)


@compiled
def coefficients(t2: float) -> tuple[float, float, float, float, float]:
    """S1, S2, S3, D1, D2 of `section.Coefficients`."""
    if t2 < SERIES_BELOW:
        # Horner's scheme of Σ (−t2)^k / (2k + 1)!, (2k + 2)!, (2k + 3)! and of the first two's derivatives.
        s1 = 1 - t2 / 6 * (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156)))))
        s2 = 0.5 * (1 - t2 / 12 * (1 - t2 / 30 * (1 - t2 / 56 * (1 - t2 / 90 * (1 - t2 / 132 * (1 - t2 / 182))))))
        s3 = (1 - t2 / 20 * (1 - t2 / 42 * (1 - t2 / 72 * (1 - t2 / 110 * (1 - t2 / 156 * (1 - t2 / 210)))))) / 6
        d1 = -(1 - t2 / 10 * (1 - t2 / 28 * (1 - t2 / 54 * (1 - t2 / 88 * (1 - t2 / 130 * (1 - t2 / 180)))))) / 6
        d2 = -(1 - t2 / 15 * (1 - t2 * 3 / 112 * (1 - t2 * 2 / 135 * (1 - t2 * 5 / 528 * (1 - t2 * 3 / 455))))) / 24
        return s1, s2, s3, d1, d2
    theta = np.sqrt(t2)
    half = np.sin(0.5 * theta)
    cos = np.cos(theta)
    s1 = np.sin(theta) / theta
    s2 = 2.0 * half * half / t2
    return s1, s2, (1.0 - s1) / t2, 0.5 * (cos - s1) / t2, 0.5 * (s1 - 2.0 * s2) / t2


@compiled
def _place(q: Any, layout: Any, lengths_m: Any, active_length_m: float) -> Any:
    """Lengths, exposed lengths, bends (none inside the introducer), and the frames at base and section ends."""
    n = layout.shape[0]
    lengths, exposed, bends = np.empty(n), np.empty(n), np.empty((n, 2))
    R, p = np.zeros((n + 1, 3, 3)), np.zeros((n + 1, 3))
    c, s = np.cos(q[0]), np.sin(q[0])
    R[0, 0, 0], R[0, 0, 1], R[0, 1, 0], R[0, 1, 1], R[0, 2, 2] = c, -s, s, c, 1.0
    p[0, 2] = q[1] - active_length_m
    start = 0.0
    for i in range(n):
        at, at_length = layout[i]
        lengths[i] = lengths_m[i] if at_length < 0 else q[at_length]
        inside = max(active_length_m - q[1] - start, 0.0)
        if inside < EXPOSURE_TOLERANCE_M:
            inside = 0.0
        exposed[i] = lengths[i] - inside
        if exposed[i] < EXPOSURE_TOLERANCE_M:
            exposed[i] = 0.0
        outside = 1.0 if exposed[i] > 0.0 else 0.0
        bends[i, 0], bends[i, 1] = outside * q[at], outside * q[at + 1]
        start += lengths[i]
        _advance(R[i], p[i], bends[i, 0], bends[i, 1], lengths[i] - exposed[i], exposed[i], R[i + 1], p[i + 1])
    return lengths, exposed, bends, R, p


@compiled
def _advance(R: Any, p: Any, x: float, y: float, straight: float, arc: float, R_out: Any, p_out: Any) -> None:
    """Go along a straight piece and an arc of bend (x, y) from the frame (R, p) (C-1 … C-3)."""
    t2 = x * x + y * y
    s1, s2, _, _, _ = coefficients(t2)
    tx, ty, tz = arc * s2 * x, arc * s2 * y, straight + arc * s1
    xx, xy, yy, zz = 1.0 - s2 * x * x, -s2 * x * y, 1.0 - s2 * y * y, 1.0 - s2 * t2
    zx, zy = s1 * x, s1 * y
    for r in range(3):
        a, b, c = R[r, 0], R[r, 1], R[r, 2]
        p_out[r] = p[r] + a * tx + b * ty + c * tz
        R_out[r, 0] = a * xx + b * xy - c * zx
        R_out[r, 1] = a * xy + b * yy - c * zy
        R_out[r, 2] = a * zx + b * zy + c * zz


@compiled
def _turn(R: Any, v0: float, v1: float, v2: float) -> tuple[float, float, float]:
    return (
        R[0, 0] * v0 + R[0, 1] * v1 + R[0, 2] * v2,
        R[1, 0] * v0 + R[1, 1] * v1 + R[1, 2] * v2,
        R[2, 0] * v0 + R[2, 1] * v1 + R[2, 2] * v2,
    )


@compiled
def _bend_slopes(R: Any, x: float, y: float, length: float, out: Any) -> None:
    """∂t/∂b and ω/∂b of `section.jacobian`, turned by R: into out (2, 6), one row for b_x and one for b_y."""
    _, s2, s3, d1, d2 = coefficients(x * x + y * y)
    cross = 2.0 * length * d2 * x * y
    out[0, 0], out[0, 1], out[0, 2] = _turn(R, length * (s2 + 2.0 * d2 * x * x), cross, 2.0 * length * d1 * x)
    out[1, 0], out[1, 1], out[1, 2] = _turn(R, cross, length * (s2 + 2.0 * d2 * y * y), 2.0 * length * d1 * y)
    out[0, 3], out[0, 4], out[0, 5] = _turn(R, -s3 * x * y, 1.0 - s3 * y * y, -s2 * y)
    out[1, 3], out[1, 4], out[1, 5] = _turn(R, s3 * x * x - 1.0, s3 * x * y, s2 * x)


@compiled
def _jacobian(layout: Any, size: int, lengths: Any, exposed: Any, bends: Any, R: Any, p: Any) -> Any:
    """`Backbone.tip_jacobian`."""
    n = layout.shape[0]
    out = np.zeros((6, size))
    tip = p[n]
    out[0, 0], out[1, 0], out[5, 0], out[2, 1] = -tip[1], tip[0], 1.0, 1.0
    entering, slopes = -1, np.empty((2, 6))
    for i in range(n):
        at, at_length = layout[i]
        x, y, length = bends[i, 0], bends[i, 1], exposed[i]
        s1, s2, _, _, _ = coefficients(x * x + y * y)
        if length > 0.0:
            arm = tip - p[i + 1]
            _bend_slopes(R[i], x, y, length, slopes)
            for k in range(2):
                v0, v1, v2, w0, w1, w2 = slopes[k]
                out[0, at + k] = v0 + w1 * arm[2] - w2 * arm[1]
                out[1, at + k] = v1 + w2 * arm[0] - w0 * arm[2]
                out[2, at + k] = v2 + w0 * arm[1] - w1 * arm[0]
                out[3, at + k], out[4, at + k], out[5, at + k] = w0, w1, w2
        along = _turn(R[i], s2 * x, s2 * y, s1)
        if 0.0 < length < lengths[i]:
            entering = i
            out[0, 1], out[1, 1], out[2, 1] = along
        if at_length >= 0:
            out[0, at_length], out[1, at_length], out[2, at_length] = along
    for i in range(entering):
        if layout[i, 1] >= 0:
            out[:3, layout[i, 1]] = out[:3, 1]
    return out


@compiled
def _points(lengths: Any, exposed: Any, bends: Any, R: Any, p: Any, arc_lengths: Any) -> Any:
    """`Backbone.poses_at` for rising arc lengths, none of them beyond the tip."""
    n, count = lengths.shape[0], arc_lengths.shape[0]
    positions, rotations = np.empty((count, 3)), np.empty((count, 3, 3))
    i, start = 0, 0.0
    for k in range(count):
        s = arc_lengths[k]
        while i < n - 1 and s >= start + lengths[i]:
            start += lengths[i]
            i += 1
        inside = lengths[i] - exposed[i]
        along = min(s - start, lengths[i])
        arc = max(along - inside, 0.0)
        share = arc / exposed[i] if exposed[i] > 0.0 else 0.0
        _advance(
            R[i], p[i], share * bends[i, 0], share * bends[i, 1], min(along, inside), arc, rotations[k], positions[k]
        )
    return positions, rotations


@compiled
def positions_at(q: Any, layout: Any, lengths_m: Any, active_length_m: float, arc_lengths: Any) -> Any:
    """Positions (count, 3) at rising arc lengths from the base of the active segment, none of them beyond the tip."""
    lengths, exposed, bends, R, p = _place(q, layout, lengths_m, active_length_m)
    return _points(lengths, exposed, bends, R, p, arc_lengths)[0]


@compiled
def tick(q: Any, rest: Any, layout: Any, lengths_m: Any, active_length_m: float, matrix: Any, count: int) -> Any:
    lengths, exposed, bends, R, p = _place(q, layout, lengths_m, active_length_m)
    n = lengths.shape[0]
    positions, rotations = _points(lengths, exposed, bends, R, p, np.linspace(0.0, lengths.sum(), count))
    tip = np.eye(4)
    tip[:3, :3] = R[n]
    tip[:3, 3] = p[n]
    jacobian = _jacobian(layout, q.shape[0], lengths, exposed, bends, R, p)
    tendons = np.zeros(matrix.shape[0])
    for j in range(matrix.shape[0]):
        for k in range(q.shape[0]):
            tendons[j] += matrix[j, k] * (q[k] - rest[k])
    return positions, rotations, tip, jacobian, tendons


@compiled
def path_at(path: Any, spacing: float, s: float) -> tuple[float, float, float, float, float, float]:
    """Position and unit tangent at arc length s of a polyline that starts at the port, lengthened straight at its ends."""
    if s <= 0.0:
        return 0.0, 0.0, s, 0.0, 0.0, 1.0
    last = path.shape[0] - 2
    k = min(int(s / spacing), last)
    along = s / spacing - k
    dx, dy, dz = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1], path[k + 1, 2] - path[k, 2]
    size = np.sqrt(dx * dx + dy * dy + dz * dz)
    return (
        path[k, 0] + along * dx,
        path[k, 1] + along * dy,
        path[k, 2] + along * dz,
        dx / size,
        dy / size,
        dz / size,
    )


@compiled
def _cross_track(x: Any, path: Any, spacing: float, s: float, out: Any) -> tuple[float, float, float]:
    """Vector from the path to x across it, into `out`; the path's tangent at the foot. The search starts at s."""
    for _ in range(3):
        px, py, pz, tx, ty, tz = path_at(path, spacing, s)
        s += (x[0] - px) * tx + (x[1] - py) * ty + (x[2] - pz) * tz
    px, py, pz, tx, ty, tz = path_at(path, spacing, s)
    along = (x[0] - px) * tx + (x[1] - py) * ty + (x[2] - pz) * tz
    out[0], out[1], out[2] = x[0] - px - along * tx, x[1] - py - along * ty, x[2] - pz - along * tz
    return tx, ty, tz


@compiled
def _normal_equations(
    q: Any, layout: Any, lengths_m: Any, active_length_m: float, path: Any, spacing: float, count: int
) -> Any:
    """Gauss-Newton's H, g and cost of ½ Σ w |cross-track|² at points evenly along the exposed body, and the distances.

    The last point is the tip; it weighs as much as all points together.
    """
    lengths, exposed, bends, R, p = _place(q, layout, lengths_m, active_length_m)
    n = lengths.shape[0]
    H, g, distances = np.zeros((2 * n, 2 * n)), np.zeros(2 * n), np.zeros(count)
    ends = np.empty((n, 2, 6))
    for i in range(n):
        _bend_slopes(R[i], bends[i, 0], bends[i, 1], exposed[i], ends[i])
    total, port = exposed.sum(), active_length_m - q[1]
    first = lengths.sum() - total
    J, x, e, frame, own = np.zeros((3, 2 * n)), np.empty(3), np.empty(3), np.empty((3, 3)), np.empty((2, 6))
    i, start, cost = 0, 0.0, 0.0
    for k in range(count):
        s = first + total * (k + 1) / count
        while i < n - 1 and s > start + lengths[i]:
            start += lengths[i]
            i += 1
        if exposed[i] == 0.0:
            continue
        straight = lengths[i] - exposed[i]
        arc = min(max(s - start - straight, 0.0), exposed[i])
        share = arc / exposed[i]
        bx, by = share * bends[i, 0], share * bends[i, 1]
        _advance(R[i], p[i], bx, by, straight, arc, frame, x)
        tx, ty, tz = _cross_track(x, path, spacing, s - port, e)
        distances[k] = np.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
        for m in range(i):
            ax, ay, az = x[0] - p[m + 1, 0], x[1] - p[m + 1, 1], x[2] - p[m + 1, 2]
            for c in range(2):
                v0, v1, v2, w0, w1, w2 = ends[m, c]
                J[0, 2 * m + c] = v0 + w1 * az - w2 * ay
                J[1, 2 * m + c] = v1 + w2 * ax - w0 * az
                J[2, 2 * m + c] = v2 + w0 * ay - w1 * ax
        _bend_slopes(R[i], bx, by, arc, own)
        for c in range(2):
            for r in range(3):
                J[r, 2 * i + c] = share * own[c, r]
        for a in range(2 * i + 2):
            along = J[0, a] * tx + J[1, a] * ty + J[2, a] * tz
            J[0, a] -= along * tx
            J[1, a] -= along * ty
            J[2, a] -= along * tz
        w = count if k == count - 1 else 1.0
        cost += 0.5 * w * distances[k] ** 2
        for a in range(2 * i + 2):
            g[a] += w * (J[0, a] * e[0] + J[1, a] * e[1] + J[2, a] * e[2])
            for b in range(a + 1):
                H[a, b] += w * (J[0, a] * J[0, b] + J[1, a] * J[1, b] + J[2, a] * J[2, b])
    for a in range(2 * n):
        for b in range(a):
            H[b, a] = H[a, b]
    return H, g, cost, distances


@compiled
def _into_disc(point: Any, radius: float) -> bool:
    """Shorten a bend (2,) to its limit if it is beyond; whether it was."""
    size = np.sqrt(point[0] * point[0] + point[1] * point[1])
    if size <= radius:
        return False
    point *= radius / size
    return True


@compiled
def _step_in_discs(H: Any, g: Any, bends: Any, radius: Any, free: Any) -> Any:
    """Minimise ½ dᵀHd + gᵀd with |b_i + d_i| ≤ radius_i: whoever leaves its disc is set on the rim, the others solve again."""
    n = bends.shape[0]
    step, held = np.zeros(2 * n), np.empty(2 * n, np.bool_)
    for a in range(2 * n):
        held[a] = not free[a // 2]
    for _ in range(n):
        A, r = H.copy(), -g
        for a in range(2 * n):
            if held[a]:
                r -= H[:, a] * step[a]
        for a in range(2 * n):
            if held[a]:
                A[a, :] = 0.0
                A[:, a] = 0.0
                A[a, a], r[a] = 1.0, step[a]
        step = np.linalg.solve(A, r)
        left = False
        for i in range(n):
            point = bends[i] + step[2 * i : 2 * i + 2]
            if not held[2 * i] and _into_disc(point, radius[i]):
                step[2 * i : 2 * i + 2] = point - bends[i]
                held[2 * i], held[2 * i + 1], left = True, True, True
        if not left:
            break
    return step


@compiled
def fit_path(
    q: Any,
    layout: Any,
    free: Any,
    lengths_m: Any,
    active_length_m: float,
    max_curvature: Any,
    path: Any,
    spacing: float,
    count: int,
    iterations: int,
) -> Any:
    """Bends that lay the exposed body on the path: damped Gauss-Newton on the cross-track error from the bends in q.

    Returns q, the distances (count,) at points evenly along the exposed body, the last at the tip, and the iterations.
    A step is taken only when it lowers the error (Levenberg-Marquardt). |b_i| ≤ κ_max,i ℓ_e,i holds throughout.
    """
    n = layout.shape[0]
    _, exposed, _, _, _ = _place(q, layout, lengths_m, active_length_m)
    radius, bends = max_curvature * exposed, np.empty((n, 2))
    q = q.copy()
    for i in range(n):
        _into_disc(q[layout[i, 0] : layout[i, 0] + 2], radius[i])
    H, g, cost, distances = _normal_equations(q, layout, lengths_m, active_length_m, path, spacing, count)
    damping, done = 1e-9, 0
    while done < iterations:
        done += 1
        A = H.copy()
        lift = damping * np.trace(H) + 1e-15
        for a in range(2 * n):
            A[a, a] += lift
        for i in range(n):
            bends[i] = q[layout[i, 0] : layout[i, 0] + 2]
        step = _step_in_discs(A, g, bends, radius, free)
        tried = q.copy()
        for i in range(n):
            tried[layout[i, 0] : layout[i, 0] + 2] += step[2 * i : 2 * i + 2]
        H_tried, g_tried, cost_tried, distances_tried = _normal_equations(
            tried, layout, lengths_m, active_length_m, path, spacing, count
        )
        if cost_tried < cost:
            gain = cost - cost_tried
            q, H, g, distances, cost = tried, H_tried, g_tried, distances_tried, cost_tried
            damping *= 0.1
            if gain < 1e-4 * cost:
                break
        else:
            damping = max(10.0 * damping, 1e-5)
    return q, distances, done


@compiled
def distances_to_path(
    q: Any, layout: Any, lengths_m: Any, active_length_m: float, path: Any, spacing: float, count: int
) -> Any:
    """Distance of the exposed body from the path (count,) [m], evenly along the body, the last at the tip."""
    return _normal_equations(q, layout, lengths_m, active_length_m, path, spacing, count)[3]


@compiled
def sequential_fit(
    q: Any,
    layout: Any,
    free: Any,
    lengths_m: Any,
    active_length_m: float,
    max_curvature: Any,
    path: Any,
    spacing: float,
) -> Any:
    """The baseline: base to tip, each section the one arc towards its end's place on the path.

    d = Rᵀ (r(s_i) − p), ρ = |d_xy|, b = 2 atan2(ρ, d_z)/ρ d_xy; 0 behind the port; shortened to its limit.
    """
    n = layout.shape[0]
    lengths, exposed, _, R, p = _place(q, layout, lengths_m, active_length_m)
    q = q.copy()
    end = q[1] - active_length_m
    for i in range(n):
        end += lengths[i]
        at = layout[i, 0]
        straight = lengths[i] - exposed[i]
        if free[i]:
            rx, ry, rz, _, _, _ = path_at(path, spacing, end)
            foot = p[i] + straight * R[i, :, 2]
            dx, dy, dz = _turn(R[i].T, rx - foot[0], ry - foot[1], rz - foot[2])
            rho = np.sqrt(dx * dx + dy * dy)
            bend = min(2.0 * np.arctan2(rho, dz), max_curvature[i] * exposed[i])
            q[at] = bend * dx / rho if rho > 1e-15 else 0.0
            q[at + 1] = bend * dy / rho if rho > 1e-15 else 0.0
        if exposed[i] == 0.0:
            q[at], q[at + 1] = 0.0, 0.0
        _advance(R[i], p[i], q[at], q[at + 1], straight, exposed[i], R[i + 1], p[i + 1])
    return q
