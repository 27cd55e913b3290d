"""Claims about recordings: right ones are read in SI units, and whatever is wrong is named with file, row and column."""

import csv

import numpy as np
import pytest

from cobra.loading import load_description
from cobra.mechanics.recordings import conventional_columns, load_columns, read_recording, thinned
from cobra.mechanics.tables import RecordingError, read_quantities
from tests.calibration_recordings import REAL_ROBOT, nominal_robot, real_recording, synthetic, write_conventional

ROBOT = nominal_robot()
COLUMNS = """
time = "t"
time_unit = "ms"
tendons = [["a", "b", "c", "d"], ["e", "f", "g"]]
travel_unit = "mm"
travel_positive = "wound-in"
tip = ["x", "y", "z"]
tip_unit = "m"
"""


@pytest.fixture(scope="module")
def made():
    return synthetic(84)


@pytest.fixture
def path(tmp_path, made):
    write_conventional(tmp_path / "motion.csv", made[1])
    return tmp_path / "motion.csv"


def rows_of(path):
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def rewrite(path, change):
    rows = rows_of(path)
    change(rows)
    with path.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows(rows)


def read(path, *, skip_bad_rows=False):
    return read_recording(path, conventional_columns(path, ROBOT), ROBOT, skip_bad_rows=skip_bad_rows)


def put(row, column, value):
    def change(rows):
        rows[row - 1][rows[0].index(column)] = value

    return change


def scaled(row, columns, factor):
    def change(rows):
        for column in columns:
            place = rows[0].index(column)
            rows[row - 1][place] = repr(float(rows[row - 1][place]) * factor)

    return change


def without_column(column):
    def change(rows):
        place = rows[0].index(column)
        for row in rows:
            del row[place]

    return change


def renamed(column, name):
    def change(rows):
        rows[0][rows[0].index(column)] = name

    return change


TIP = ("tip_x_mm", "tip_y_mm", "tip_z_mm")
TENDONS = tuple(f"{name}_mm" for name in ROBOT.tendon_names)


def test_a_recording_with_conventional_names_needs_no_map(path, made):
    _, told = made
    recording = read(path)
    assert recording.paid_out_m == pytest.approx(-told.wound_m, abs=1e-8)
    assert recording.tip_m == pytest.approx(told.tip_m, abs=1e-8)
    assert recording.time_s[:3] == pytest.approx([0.0, 0.5, 1.0])
    assert recording.block_names[:2] == ("motion 0-0", "motion 0-1")
    assert [str(recording.block_names[b]) for b in recording.block] == list(told.motion)


def test_a_map_of_columns_says_names_and_units(tmp_path, made):
    _, told = made
    (tmp_path / "columns.toml").write_text(COLUMNS, encoding="utf-8")
    with (tmp_path / "motion.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["z", "y", "x", "t", *"gfedcba", "remark"])
        for i in range(len(told.tip_m)):
            writer.writerow([*told.tip_m[i][::-1], 500 * i, *(1e3 * told.wound_m[i][::-1]), "seen"])
    recording = read_recording(tmp_path / "motion.csv", load_columns(tmp_path / "columns.toml"), ROBOT)
    assert recording.paid_out_m == pytest.approx(-told.wound_m)
    assert recording.tip_m == pytest.approx(told.tip_m)
    assert recording.time_s[:2] == pytest.approx([0.0, 0.5])
    assert recording.sign_known
    assert len(recording.block_names) == 4, "without names, blocks are contiguous stretches"


def test_shaft_angles_become_travel_over_each_drive_s_spool(path, made):
    def in_degrees(rows):
        for name in TENDONS:
            place = rows[0].index(name)
            rows[0][place] = name.replace("_mm", "_deg")
            for row in rows[1:]:
                row[place] = repr(float(np.degrees(float(row[place]) * 1e-3 / 0.01)))

    rewrite(path, in_degrees)
    recording = read(path)
    assert recording.of_shafts
    assert recording.paid_out_m == pytest.approx(-made[1].wound_m, abs=1e-8)


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (without_column("tip_z_mm"), "'tip_z_mm'"),
        (without_column("t21_mm"), "'t21_mm'"),
        (without_column("time_s"), "'time_s'"),
        (renamed("t12_mm", "t12_deg"), "'t12_deg' is in another unit than 't11_mm'"),
        (put(7, "tip_x_mm", "nan"), "row 7: tip_x_mm = nan is not a finite number"),
        (put(7, "t13_mm", "inf"), "row 7: t13_mm = inf"),
        (put(9, "t13_mm", "1,5"), "row 9: t13_mm = '1,5' is not a number"),
        (put(9, "tip_y_mm", ""), "row 9: tip_y_mm = ''"),
        (put(11, "time_s", "4.000"), "row 11: time_s = 4.0 repeats row 10"),
        (put(11, "time_s", "3.2"), "row 11: time_s = 3.2 goes back behind row 10"),
        (scaled(12, TIP, 1e-3), "row 12: the tip (tip_x_mm, tip_y_mm, tip_z_mm) fits its neighbours only when"),
        (scaled(2, TIP, 1e-3), "row 2: the tip"),
        (scaled(20, TIP, 1e3), "row 20: the tip"),
        (scaled(12, TENDONS, 1e-3), "row 12: the travel"),
        (lambda rows: rows[5].append("more"), "row 6: has 13 values for 12 columns"),
        (lambda rows: rows.__delitem__(slice(1, None)), "no usable row"),
        (lambda rows: rows.clear(), "'time_s' or 'time_ms' is missing; there are none"),
    ],
)
def test_what_is_wrong_is_named_with_its_row_and_column(path, change, says):
    rewrite(path, change)
    with pytest.raises(RecordingError) as caught:
        read(path)
    message = str(caught.value)
    assert says in message
    assert str(path) in message
    assert "\n" not in message


@pytest.mark.parametrize(
    ("columns", "factor", "says"),
    [
        (TIP, 1e-3, r"is it in mm\?"),
        (TIP, 1e3, r"is it in mm\?"),
        (TENDONS, 1e-3, r"are they in mm\?"),
        (TENDONS, 1e3, r"are they in mm\?"),
    ],
)
def test_a_whole_column_in_another_unit_is_noticed_by_the_robot_s_size(path, columns, factor, says):
    def change(rows):
        for i in range(2, len(rows) + 1):
            scaled(i, columns, factor)(rows)

    rewrite(path, change)
    with pytest.raises(RecordingError, match=says) as caught:
        read(path)
    assert str(path.name) in str(caught.value)


def test_bad_rows_are_left_out_only_on_request_and_are_listed(path, made):
    def change(rows):
        put(7, "tip_x_mm", "nan")(rows)
        put(20, "time_s", rows[18][0])(rows)
        scaled(30, TIP, 1e-3)(rows)

    rewrite(path, change)
    recording = read(path, skip_bad_rows=True)
    assert [reason.split(":")[0] for reason in recording.skipped] == ["row 7", "row 20", "row 30"]
    assert len(recording) == len(made[1].tip_m) - 3
    assert set(recording.rows.tolist()) == set(range(2, len(made[1].tip_m) + 2)) - {7, 20, 30}
    kept = recording.rows - 2
    assert recording.tip_m == pytest.approx(made[1].tip_m[kept], abs=1e-8)


def test_a_long_recording_is_thinned_evenly_and_keeps_its_motions(path, made):
    recording = read(path)
    assert thinned(recording, 84) is recording
    thin = thinned(recording, 30)
    assert len(thin) == 28
    assert thin.tip_m == pytest.approx(recording.tip_m[::3])
    assert [thin.block_names[b] for b in thin.block] == list(made[1].motion[::3])


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("tip_unit", "tip_units"), "tip_units"),
        (('"ms"', '"hours"'), "hours"),
        (('["e", "f", "g"]', '["e", "f"]'), "[4, 2]"),
        (('travel_unit = "mm"', ""), "travel_unit"),
    ],
)
def test_a_wrong_map_of_columns_is_one_line(tmp_path, path, change, says):
    (tmp_path / "columns.toml").write_text(COLUMNS.replace(*change), encoding="utf-8")
    with pytest.raises(RecordingError) as caught:
        read_recording(path, load_columns(tmp_path / "columns.toml"), ROBOT)
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_quantity_in_two_units_is_ambiguous(tmp_path):
    (tmp_path / "a.csv").write_text("angle_deg,angle_rad\n1,2\n", encoding="utf-8")
    with pytest.raises(RecordingError, match="'angle_deg' and 'angle_rad'; give one"):
        read_quantities(tmp_path / "a.csv", {"angle": {"deg": 1.0, "rad": 1.0}})


def test_the_real_recording_is_read_as_its_readme_says():
    folder = real_recording()
    robot = load_description(REAL_ROBOT / "robot.toml")
    recording = read_recording(folder / "train.csv", load_columns(REAL_ROBOT / "columns.toml"), robot)
    assert len(recording) == 1620
    assert not recording.sign_known
    assert not recording.skipped
    assert np.abs(recording.paid_out_m).max() == pytest.approx(0.010, abs=0.005)
    assert np.linalg.norm(recording.tip_m, axis=-1).max() < 0.2
