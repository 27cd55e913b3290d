"""What the page is told of load cells, and what it may ask for."""

import math

import pytest

from app.console.commissioning_view import cell_warnings, commissioning_request, commissioning_state
from cobra.messages import Cell
from tests.app.console.scene_fakes import state_of


def cell(tendon: str, trouble: str = "") -> Cell:
    return Cell(tendon=tendon, tension=1.0, reading=1.0, age=0.0, trouble=trouble)


def test_what_is_wrong_with_many_cells_is_said_once() -> None:
    cells = (
        *(cell(f"S{i}", "not tared yet") for i in range(6)),
        cell("N1"),
        cell("E1", "silent"),
        cell("E2", "silent"),
    )
    assert cell_warnings(cells) == ["load cells of 6 tendons: not tared yet", "load cells of E1, E2: silent"]


@pytest.mark.parametrize(("text", "force"), [("S1 9.81", 9.81), ("S1 9,81", 9.81), ("W3 20", 20.0)])
def test_a_known_force_is_read_as_people_write_it(text: str, force: float) -> None:
    request, refusal = commissioning_request("calibrate_cell", None, text)
    assert refusal == ""
    assert request is not None
    assert (request.what, request.name, request.value) == ("calibrate_cell", text.split(maxsplit=1)[0], force)


@pytest.mark.parametrize("text", ["S1", "S1 ", "S1 much", "S1 inf", "S1 nan", "9.81", ""])
def test_what_is_no_force_is_refused(text: str) -> None:
    request, refusal = commissioning_request("calibrate_cell", None, text)
    assert request is None
    assert "give newtons" in refusal


def test_a_cell_is_shown_beside_what_its_motors_current_says() -> None:
    believed = Cell(tendon="S1", tension=8.1, from_current=7.4, reading=8.5, age=0.0)
    dead = Cell(tendon="E1", tension=math.nan, from_current=7.9, reading=math.nan, age=math.inf, trouble="silent")
    first, second = commissioning_state(state_of(cells=(believed, dead)))["cells"]
    assert (first["tension"], first["from_current"], first["trouble"]) == (8.1, 7.4, "")
    # Not nothing: not known.
    assert (second["tension"], second["from_current"], second["trouble"]) == (None, 7.9, "silent")
