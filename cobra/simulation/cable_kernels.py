"""The compiled half of `cables.py`: springs in series, with Coulomb friction at the nodes between them.

Arrays are (tendons, elements), motor first. Element p is stretched by e and carries T = k max(0, e). At the node between p and
p + 1 the tendon is stuck while T_p / c ≤ T_{p+1} ≤ c T_p, c = exp(μ θ), and slides as far as brings it back to that cone.
"""

from typing import Any

from cobra.kinematics.kernels import compiled

MAX_SWEEPS = 40
TOLERANCE = 1e-4
"""Of a tension, by which a ratio may leave its cone."""
SLIDING = 1e-3
"""Nearer to the edge of its cone than this, relatively, a node counts as sliding."""


@compiled
def _slide(e: Any, k: Any, c: float, p: int) -> bool:
    here, there = k[p] * max(0.0, e[p]), k[p + 1] * max(0.0, e[p + 1])
    if here > c * there * (1.0 + TOLERANCE):
        giver, taker = p, p + 1
    elif there > c * here * (1.0 + TOLERANCE):
        giver, taker = p + 1, p
    else:
        return False
    # The giver keeps c times what the taker has; a taker that stays slack takes all.
    slid = (k[giver] * e[giver] - c * k[taker] * e[taker]) / (k[giver] + c * k[taker])
    slid = min(slid, e[giver])
    e[giver] -= slid
    e[taker] += slid
    return True


@compiled
def relax(extension: Any, stiffness: Any, capstan: Any, counts: Any, tension: Any) -> None:
    """Let every node that is outside its friction cone slide, until none is: changes `extension`, fills `tension`.

    Sweeps to and fro (Gauss–Seidel). A node never slides further than to the edge of its cone, so that nothing overshoots
    and the result depends on the past only through what is stuck.
    """
    for j in range(len(counts)):
        n = counts[j]
        for sweep in range(MAX_SWEEPS):
            moved = False
            for i in range(n - 1):
                p = i if sweep % 2 == 0 else n - 2 - i
                moved = _slide(extension[j], stiffness[j], capstan[j, p], p) or moved
            if not moved:
                break
        for p in range(n):
            tension[j, p] = stiffness[j, p] * max(0.0, extension[j, p])


@compiled
def _fill(tension: Any, stiffness: Any, start: int, end: int, first: int, out: Any) -> None:
    """One run of elements: T_p = c_p T, so that T Σ c_p / k_p = Σ e_p."""
    compliance = 0.0
    for p in range(start, end + 1):
        if tension[p] > 0.0:
            compliance += tension[p] / stiffness[p]
    own = max(0, end + 1 - max(start, first))
    for p in range(start, end + 1):
        out[p] = own * tension[p] / compliance if compliance > 0.0 else 0.0


@compiled
def tangent(tension: Any, stiffness: Any, capstan: Any, counts: Any, first: int, out: Any) -> None:
    """How stiffly each element answers when all elements from `first` on lengthen together (tendons, elements) [N/m].

    Elements between which the tendon slides share their stretch; a stuck one stretches alone.
    """
    for j in range(len(counts)):
        start = 0
        n = counts[j]
        for p in range(n):
            ends = p == n - 1
            if not ends:
                low, high = tension[j, p], tension[j, p + 1]
                if low > high:
                    low, high = high, low
                ends = high < capstan[j, p] * low * (1.0 - SLIDING)
            if ends:
                _fill(tension[j], stiffness[j], start, p, first, out[j])
                start = p + 1
