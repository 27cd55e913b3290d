"""Numbers that no robot can have are refused, in one line with the reason."""

from importlib import resources

import pytest

from cobra.loading import DescriptionError, parse_description

TEXT = (resources.files("cobra") / "robots" / "cobra.toml").read_text("utf-8")
CELL = '[[load_cells]]\ntendon = "S1"\nbus = "main"\nframe_id = 0x300\nscale_N = 0.01\nrate_Hz = 100.0\n\n'


def with_cells(*cells: str) -> str:
    return TEXT.replace("[[drives]]", "".join(cells) + "[[drives]]", 1)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("axial_stiffness_N = 10180.0", "axial_stiffness_N = 1e6", ["9.82e+03 GPa", "0.1 to 1200 GPa"]),
        ("axial_stiffness_N = 10180.0", "axial_stiffness_N = 1.0", ["0.00982 GPa"]),
        ("hole_friction = 0.1 ", "hole_friction = 1.4 ", ["tendon.hole_friction = 1.4", "at most 1"]),
        ("hole_friction = 0.1 ", "hole_friction = -0.1 ", ["tendon.hole_friction = -0.1", ">= 0"]),
        ("conduit_length_m = 4.7", "conduit_length_m = 0.0", ["conduit_bend_deg = 180", "cannot bend"]),
        ("conduit_bend_deg = 180.0", "conduit_bend_deg = 18000.0", ["exp(15.7)", "stuck"]),
        ("backlash_deg = 0.8", "backlash_deg = 45.0", ["motors[0].backlash_deg = 45", "at most 20"]),
        ("spool_runout_m = 0.00005", "spool_runout_m = 0.005", ["drives[0].spool_runout_m = 0.005", "0.25"]),
        ("travel_range = [-0.060, 0.040]", "travel_range = [-1.0, 1.0]", ["drives[0].winds_over", "32 layers"]),
        ("address = 14\n", "address = 14\nwinds_over = true\n", ["drives[13]", "spool of a tendon"]),
    ],
)
def test_a_loss_that_no_robot_has_is_refused_with_the_reason(old: str, new: str, says: list[str]) -> None:
    assert old in TEXT
    with pytest.raises(DescriptionError) as error:
        parse_description(TEXT.replace(old, new, 1), "robot.toml")
    assert "\n" not in str(error.value)
    for part in says:
        assert part in str(error.value)


def test_load_cells_may_share_a_frame_at_different_bytes() -> None:
    second = CELL.replace('"S1"', '"E1"').replace("scale_N", "byte_offset = 2\nscale_N")
    cells = parse_description(with_cells(CELL, second), "robot.toml").load_cells
    assert [(cell.tendon, cell.byte_offset, cell.size) for cell in cells] == [("S1", 0, 2), ("E1", 2, 2)]


@pytest.mark.parametrize(
    ("cells", "says"),
    [
        ((CELL.replace('"S1"', '"S9"'),), "load_cells[0].tendon = 'S9': no such tendon"),
        ((CELL.replace('"main"', '"side"'),), "load_cells[0].bus = 'side': no such bus"),
        ((CELL.replace("0x300", "0x143"),), "load_cells[0].frame_id = 0x143: the drives"),
        ((CELL.replace("scale_N", 'type = "f32le"\nbyte_offset = 6\nscale_N'),), "f32le needs 4 bytes"),
        ((CELL, CELL.replace("0x300", "0x301")), "load_cells[0] measures it already"),
        ((CELL, CELL.replace('"S1"', '"E1"').replace("scale_N", "byte_offset = 1\nscale_N")), "overlaps load_cells[0]"),
        (
            (
                CELL,
                CELL.replace('"S1"', '"E1"').replace("scale_N", "byte_offset = 2\nscale_N").replace("100.0", "50.0"),
            ),
            "at 100 Hz",
        ),
    ],
)
def test_a_load_cell_that_cannot_be_is_refused(cells: tuple[str, ...], says: str) -> None:
    with pytest.raises(DescriptionError) as error:
        parse_description(with_cells(*cells), "robot.toml")
    assert says in str(error.value)
