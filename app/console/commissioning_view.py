"""Commissioning as the operator's page sees and asks for it."""

import math
from typing import TypedDict

from cobra.messages import Cell, Request, RobotState


class FoundState(TypedDict):
    """One thing that a step found out."""

    drive: str
    check: str
    ok: bool
    words: str


class CellState(TypedDict):
    """A tendon's load cell; `tension`, `from_current` (the motor's) and `reading` in N, `trouble` in words, empty for none."""

    tendon: str
    tension: float | None
    from_current: float | None
    reading: float | None
    trouble: str


class CommissioningState(TypedDict):
    """The step that runs or ran last; `outcome` is empty, running, done or ended."""

    step: str
    doing: str
    outcome: str
    words: str
    found: list[FoundState]
    calibration: str
    cells: list[CellState]


def commissioning_state(state: RobotState | None) -> CommissioningState:
    """For the page."""
    if state is None:
        return CommissioningState(step="", doing="", outcome="", words="", found=[], calibration="", cells=[])
    told = state.commissioning
    return CommissioningState(
        step=told.step,
        doing=told.doing,
        outcome=told.outcome,
        words=told.words,
        found=[FoundState(drive=f.drive, check=f.check, ok=f.ok, words=f.words) for f in told.found],
        calibration=told.calibration,
        cells=[
            CellState(
                tendon=c.tendon,
                tension=_number(c.tension),
                from_current=_number(c.from_current),
                reading=_number(c.reading),
                trouble=c.trouble,
            )
            for c in state.cells
        ],
    )


def cell_warnings(cells: tuple[Cell, ...]) -> list[str]:
    """What is wrong with load cells, a line each trouble."""
    who: dict[str, list[str]] = {}
    for cell in cells:
        if cell.trouble:
            who.setdefault(cell.trouble, []).append(cell.tendon)
    return [
        f"load cell{'s' if len(names) > 1 else ''} of {', '.join(names) if len(names) <= 4 else f'{len(names)} tendons'}: {trouble}"
        for trouble, names in who.items()
    ]


def commissioning_request(what: str, value: int | None, text: str) -> tuple[Request | None, str]:
    """The request to the robot; or why there is none, in words.

    `text` names a drive or tendon; for calibrate_cell it is `TENDON FORCE`, in newtons.
    """
    if what != "calibrate_cell":
        return Request(what=what, name=text, value=float(value or 0)), ""
    name, _, force = text.rpartition(" ")
    try:
        newtons = float(force.replace(",", "."))
    except ValueError:
        newtons = math.nan
    if not name or not math.isfinite(newtons):
        return None, f"{force!r} is no force: give newtons, e.g. 9.81"
    return Request(what=what, name=name, value=newtons), ""


def _number(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
