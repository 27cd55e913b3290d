"""Which effects a recording bears out: blocked cross-validation on that recording alone.

Neighbouring samples repeat each other, so single samples held out would flatter every model. Whole motions are held out
instead, all those in which the same sections move: what a model predicts there is a combination that it has not seen,
which is what it is for. One more fold trains on motions of single sections and tests on all others. The held-out motions
still drive the model (their tendon travel is known, and the past matters), but their tips are not looked at.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cobra.mechanics.calibration import Calibration, Fit, Sequence, adjust, begin, sequence, tip_errors
from cobra.mechanics.recordings import Recording
from cobra.mechanics.robot_model import EFFECTS, NEEDS_SLACK, Nominal
from cobra.mechanics.tendon_statics import solve

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]

MOVES = 0.3
"""A section moves in a block where it is told to bend by at least this share of its largest bend."""
SMALL = 0.05
"""Folds under this share of the samples are held out together."""
PARTS = 5
"""Contiguous folds where the recording has only one kind of motion."""
GAIN = 0.005
"""An effect stays if the held-out error falls by at least this share."""
ITERATIONS = 25


class Fold(NamedTuple):
    """Samples whose tips are held out."""

    name: str
    held_out: Rows
    extrapolates: bool
    """Trained on single sections, tested on all others."""


class Trial(NamedTuple):
    """One model tried on all folds."""

    effects: tuple[str, ...]
    held_out_m: Floats
    """(folds,) mean tip error of the held-out samples"""
    score_m: float
    kept: bool


class Selection(NamedTuple):
    """What was tried, and the model that came out, fitted to all samples."""

    fit: Fit
    folds: tuple[Fold, ...]
    trials: tuple[Trial, ...]

    @property
    def chosen(self) -> Trial:
        """The trial of the model that came out."""
        return next(trial for trial in self.trials[::-1] if trial.kept)


def folds(plain: Fit, seen: Sequence) -> tuple[Fold, ...]:
    """Folds by which sections the tendons tell to bend, read off the plain model."""
    n = len(plain.model.robot.length_m)
    values = plain.values
    springs = plain.model.springs(values._replace(zero=np.zeros_like(values.zero)))
    bends = solve(springs, seen.drive, plain.model.robot.ends, slack=False).reshape(-1, n, 2)
    told = np.linalg.norm(bends, axis=-1)
    told /= np.quantile(told, 0.95, axis=0)
    moving = {}
    for block in range(int(seen.block.max()) + 1):
        rows = seen.block == block
        moving[block] = tuple(int(k) for k in np.flatnonzero(told[rows].max(axis=0) > MOVES))
    kind = np.array([moving[block] for block in seen.block.tolist()], dtype=object)
    kinds = sorted(set(moving.values()))
    count = {which: sum(k == which for k in kind) for which in kinds}
    large = [which for which in kinds if count[which] >= SMALL * len(kind)]
    found = [Fold(_name(which), np.array([k == which for k in kind]), False) for which in large]
    rest = np.array([k not in large for k in kind])
    if rest.any():
        found.append(Fold("other motions", rest, False))
    if len(found) < 2:
        part = seen.block * PARTS // (int(seen.block.max()) + 1)
        found = [Fold(f"part {i + 1}", part == i, False) for i in range(PARTS) if (part == i).any()]
    several = np.array([len(k) > 1 for k in kind])
    if 0.2 < several.mean() < 0.8:
        found.append(Fold("several sections, from single ones", several, True))
    return tuple(found)


def _name(which: tuple[int, ...]) -> str:
    return "sections " + " and ".join(str(k + 1) for k in which) if which else "at rest"


def select(
    plain: Fit,
    seen: Sequence,
    *,
    effects: tuple[str, ...] = tuple(EFFECTS),
    report: Callable[[str, Trial], None] = lambda effect, trial: None,
) -> Selection:
    """Try the effects one after the other, and keep those that predict the held-out motions better."""
    parts = folds(plain, seen)
    held = [adjust(plain, seen, ~part.held_out, iterations=ITERATIONS) for part in parts]
    best = _trial((), held, parts, seen, None)
    trials = [best]
    report("constant curvature", best)
    # Twice: an effect may show only once a larger one is part of the model.
    for effect in (*effects, *effects):
        if effect in best.effects:
            continue
        model = plain.model.with_effects((*best.effects, effect))
        if model.size == held[0].model.size:  # such as routing twist in a robot of one section
            continue
        tried = []
        for fit, part in zip(held, parts, strict=True):
            start = Fit(model, fit.model.carry(fit.x, model), np.inf, fit.doubt)
            tried.append(adjust(start, seen, ~part.held_out, iterations=ITERATIONS))
        trial = _trial(model.effects, tried, parts, seen, best)
        report(effect, trial)
        trials.append(trial)
        if trial.kept:
            best, held = trial, tried
    return Selection(_grow(plain, seen, best.effects), parts, tuple(trials))


def assess(plain: Fit, seen: Sequence, effects: tuple[str, ...]) -> Selection:
    """Fit given effects, and see how they predict the same held-out motions."""
    parts = folds(plain, seen)
    held = [_grow(adjust(plain, seen, ~part.held_out), seen, effects, ~part.held_out) for part in parts]
    return Selection(_grow(plain, seen, effects), parts, (_trial(effects, held, parts, seen, None),))


def _trial(
    effects: tuple[str, ...], held: list[Fit], parts: tuple[Fold, ...], seen: Sequence, best: Trial | None
) -> Trial:
    """Score: the mean of the error of all samples, each held out once, and of that where the model extrapolates."""
    errors = [tip_errors(fit, seen)[part.held_out] for fit, part in zip(held, parts, strict=True)]
    once = np.concatenate([error for error, part in zip(errors, parts, strict=True) if not part.extrapolates])
    beyond = [error.mean() for error, part in zip(errors, parts, strict=True) if part.extrapolates]
    score = float(np.mean([once.mean(), *beyond]))
    kept = best is None or score < (1.0 - GAIN) * best.score_m
    return Trial(effects, np.array([error.mean() for error in errors]), score, kept)


class Outcome(NamedTuple):
    """A calibrated robot, and how it was found."""

    calibration: Calibration
    plain: Fit
    seen: Sequence
    selection: Selection


def calibrate(
    recording: Recording,
    robot: Nominal,
    *,
    effects: tuple[str, ...] | None = None,
    report: Callable[[str, Trial], None] = lambda effect, trial: None,
) -> Outcome:
    """Calibrate a robot on a recording. Without `effects` the recording itself chooses them.

    Where the sign of the travel is not known, it is that under which tendons that only pull explain more.

    Raises:
        OperatorError: the recording is too short or hardly moves.
    """
    begun = float(recording.time_s[0])
    tried: list[tuple[float, Sequence, Fit, int]] = []
    for sign in (1,) if recording.sign_known else (1, -1):
        seen = sequence(recording, robot, reference_s=begun, sign=sign)
        plain = begin(seen, robot)
        told = plain if recording.sign_known else _grow(plain, seen, (NEEDS_SLACK,))
        tried.append((float(tip_errors(told, seen).mean()), seen, plain, sign))
    _, seen, plain, sign = min(tried, key=lambda one: one[0])
    selection = select(plain, seen, report=report) if effects is None else assess(plain, seen, effects)
    return Outcome(Calibration(selection.fit, begun, sign), plain, seen, selection)


def _grow(fit: Fit, seen: Sequence, effects: tuple[str, ...], rows: Rows | None = None) -> Fit:
    """Add the effects one by one, fitting each time: each is a good start for the next."""
    for i in range(len(effects)):
        model = fit.model.with_effects(effects[: i + 1])
        fit = adjust(Fit(model, fit.model.carry(fit.x, model), np.inf, fit.doubt), seen, rows)
    return fit
