"""Load cases: the paper's own run and do what its text says, and whatever is wrong with a file is one clear line."""

import numpy as np
import pytest

from cobra.mechanics.cases import CaseError, case_names, load_case
from cobra.mechanics.dynamics import simulate
from cobra.mechanics.measured import MeasuredError, difference, read_measured

BASE = 'title = "a case"\nduration_s = 5.0\n'
LOAD = "[[loads]]\nguider = 5\ntime_s = [1.0]\nforce_N = [[1.0, 0.0, 0.0]]\n"
CABLE = "[[cables]]\ncable = 1\ntime_s = [0.0]\nforce_N = [5.0]\n"
START = "[start]\nbend_deg = 30.0\n"


def written(folder, text):
    path = folder / "case.toml"
    path.write_text(text, encoding="utf-8")
    return path


def run(case, **options):
    return simulate(case.parameters, case.file.duration_s, case.cables, case.loads, start=case.chain(), **options)


@pytest.fixture(scope="module")
def motions():
    return {name: run(load_case(name)) for name in case_names()}


def test_every_case_of_the_paper_runs_and_comes_to_rest(motions):
    assert len(motions) == 13
    for name, motion in motions.items():
        assert np.isfinite(motion.positions_m).all(), name
        assert np.abs(motion.v[-1]).max() < 0.1, name
        assert (motion.tensions_N >= 0.0).all(), name


def test_the_simulated_case_bends_with_each_force_of_the_text(motions):
    motion = motions["paper-simulation"]
    tip, time = motion.positions_m[:, -1, 0], motion.time_s
    assert tip[time <= 5.0][-1] > 0.02, "cable 1 bends it towards +x"
    assert tip[time <= 8.0][-1] < -0.02, "cables 2 and 3 bend it back over"
    assert tip[-1] > 0.02, "5 N on the top guider push it to +x again"
    assert np.abs(motion.positions_m[..., 1]).max() < 1e-9, "all in the plane"
    lengths = motion.q[..., 3].sum(axis=1)
    assert lengths[time <= 8.0][-1] < lengths[time <= 5.0][-1] - 0.02, "more pull shortens it"


@pytest.mark.parametrize("name", [name for name in case_names() if name[-1] == "0"])
def test_the_postures_stand_still_until_the_force_comes_and_give_way_to_it(motions, name):
    case, motion = load_case(name), motions[name]
    bend = int(name[-2:])
    before = motion.time_s <= case.load_time_s
    assert np.degrees(motion.tilt_rad[0, -1]) == pytest.approx([bend, 0.0], abs=1e-6)
    assert np.abs(motion.q[before][:, :, :2] - motion.q[0, :, :2]).max() < (1e-9 if bend else 1e-2)
    force = case.loads[0].force.values[0]
    moved = (
        motion.positions_m[-1, case.loads[0].guider]
        - motion.positions_m[np.flatnonzero(before)[-1], case.loads[0].guider]
    )
    assert moved @ force > 1e-3 * np.abs(force).sum()


def test_actuation_in_the_plane_swings_as_the_paper_tells(motions):
    first, second = (np.degrees(motions[f"actuation-plane-{k}"].tilt_rad[:, -1, 0]) for k in (1, 2))
    time = motions["actuation-plane-1"].time_s
    assert first[0] == 0.0
    assert first[time <= 6.0][-1] < -40.0
    assert -20.0 < first[-1] < -1.0
    assert second[time <= 6.0][-1] < -15.0
    assert second[-1] > 15.0


@pytest.mark.parametrize(("name", "direction"), [("actuation-space-1", 0.0), ("actuation-space-2", 120.0)])
def test_actuation_in_space_begins_in_the_direction_of_the_first_cable(motions, name, direction):
    motion = motions[name]
    x, y = motion.positions_m[motion.time_s <= 4.9][-1, -1, :2]
    assert np.degrees(np.arctan2(y, x)) == pytest.approx(direction, abs=0.1)
    x, y = motion.positions_m[motion.time_s <= 9.9][-1, -1, :2]
    assert abs(np.degrees(np.arctan2(y, x)) - direction) > 20.0


def test_every_case_runs_in_the_published_form_too():
    for name in case_names():
        motion = run(load_case(name), formulation="published")
        assert np.isfinite(motion.positions_m).all(), name


def test_lengths_that_hold_a_posture_hold_it_against_a_force_better_than_forces_do(tmp_path):
    forces, lengths = (
        run(load_case(written(tmp_path, BASE + START + f'hold = "{hold}"\n' + LOAD))) for hold in ("forces", "lengths")
    )
    assert forces.q[0] == pytest.approx(lengths.q[0], abs=1e-12)
    sag = [np.abs(motion.positions_m[-1, -1] - motion.positions_m[0, -1]).max() for motion in (forces, lengths)]
    assert sag[1] < 0.5 * sag[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("title = ", "not valid TOML"),
        (BASE + 'mouting = "hanging"', "mouting: unknown key; allowed here: title, note, duration_s"),
        (BASE + LOAD + "where = 1", r"loads\[0\].where: unknown key; allowed here: guider, time_s, force_N"),
        (BASE + "[robot]\nstiffness = 1.0", "robot.stiffness: unknown key; allowed here: segments, rest_length_m"),
        (BASE + "[robot]\nbending_stiffness_Nm2 = -0.1", r"robot.bending_stiffness_Nm2 = -0.1: expected `float` > 0.0"),
        (BASE + "[robot]\ncable_azimuths_deg = [0.0, 10.0, 20.0]", "cables must surround the backbone"),
        (BASE + "[robot]\nlocked_length_m = 0.045", "must increase in this order"),
        (BASE + "[robot]\ngravity_m_s2 = [0.0, 0.0, 1.0]", "robot.gravity_m_s2: give it as mounting"),
        ('title = "a"', "duration_s: missing"),
        ('title = "a"\nduration_s = -1.0', "duration_s = -1.0: expected `float` > 0.0"),
        (BASE + "record_s = 1e-9", "more than 1000000 times"),
        (
            BASE + 'mounting = "sideways"',
            "mounting = 'sideways': must be one of hanging, upright, horizontal, weightless",
        ),
        (
            BASE + LOAD.replace("5", "6", 1),
            r"loads\[0\].guider = 6: there is no such guider; .* 1 \(base\) to 5 \(top\)",
        ),
        (BASE + LOAD.replace("5", "0", 1), r"loads\[0\].guider = 0: expected `int` >= 1"),
        (BASE + "[robot]\nsegments = 3\n" + LOAD, r"loads\[0\].guider = 5: there is no such guider; .* to 3 \(top\)"),
        (
            BASE + "[[loads]]\nguider = 1\ntime_s = [1.0, 0.5]\nforce_N = [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]]",
            r"loads\[0\].time_s\[1\] = 0.5: follows 1; times must increase",
        ),
        (BASE + LOAD.replace("[1.0]", "[9.0]"), r"loads\[0\].time_s\[0\] = 9: not before the end, duration_s = 5"),
        (BASE + LOAD.replace("[1.0]", "[1.0, 2.0]"), r"loads\[0\].time_s: 2 times for 1 values of force_N"),
        (
            BASE + LOAD.replace("1.0, 0.0, 0.0", "nan, 0.0, 0.0"),
            r"loads\[0\].force_N\[0\]\[0\] = nan: must be a finite",
        ),
        (BASE + CABLE.replace("5.0", "-5.0"), r"cables\[0\].force_N = \[-5.0\]: must not be negative"),
        (BASE + CABLE.replace("5.0", '"five"'), r"cables\[0\].force_N\[0\] = 'five': expected `float`"),
        (
            BASE + CABLE.replace("= 1", "= 4"),
            r"cables\[0\].cable = 4: there is no such cable; they are numbered 1 to 3",
        ),
        (BASE + CABLE + CABLE, r"cables\[1\].cable = 1: has a command already"),
        (BASE + CABLE.replace("force_N = [5.0]", ""), r"cables\[0\]: give either force_N or length_m"),
        (
            BASE + CABLE + CABLE.replace("= 1", "= 2").replace("force_N", "length_m"),
            "all cables of a case are driven by",
        ),
        (BASE + START + 'hold = "lengths"\n' + CABLE, r"start.hold = 'lengths' drives the cables by lengths"),
        (BASE + START + "length_m = 0.27", "start: this posture cannot be held: cable .* would have to push"),
        (
            BASE + START + "length_m = 0.19",
            "start: this posture cannot be held: chamber .* shorter than its stop allows",
        ),
        (BASE + START.replace("30", "9000"), "start: no posture in balance was found"),
        (BASE + '[[reported]]\nquantity = "x"\nguiders = [9]', r"reported\[0\].guiders: there is no guider 9"),
    ],
)
def test_a_bad_case_is_one_clear_line(tmp_path, text, message):
    with pytest.raises(CaseError, match=message) as caught:
        load_case(written(tmp_path, text))
    assert str(caught.value).startswith(str(tmp_path / "case.toml"))
    assert "\n" not in str(caught.value)


def test_a_case_that_is_not_there_lists_those_that_are():
    with pytest.raises(
        CaseError, match=r"nowhere.toml: cannot be read .* one of the cases actuation-plane-1, .*paper-simulation"
    ):
        load_case("nowhere.toml")


HEADER = "time_s,x5_mm,z5_mm,tilt_x5_deg\n"
ROWS = "0.0,0.0,250.0,0.0\n1.0,12.0,249.0,1.5\n"


@pytest.fixture
def recording(tmp_path):
    def write(text):
        path = tmp_path / "track.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_a_recording_is_read_in_its_units_and_compared_as_measured_minus_simulated(recording, motions):
    motion = motions["paper-simulation"]
    measured = read_measured(recording(HEADER + ROWS), motion.parameters)
    assert measured.positions_m[1, 4] == pytest.approx([0.012, np.nan, 0.249], nan_ok=True)
    assert measured.tilt_rad[1, 4, 0] == pytest.approx(np.radians(1.5))
    error = difference(motion, measured)
    at = np.searchsorted(motion.time_s, 1.0)
    assert error.positions_m[1, 4, 0] == pytest.approx(0.012 - motion.positions_m[at, 5, 0])
    assert error.tilt_rad[0, 4, 0] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("t,x5_mm\n0,1\n", "column time_s is missing; there are t, x5_mm"),
        ("time_s,x6_mm\n0,1\n", "column 'x6_mm' is unknown; there may be time_s and, for the guiders 1 to 5"),
        ("time_s,x5_mm,x5_m\n0,1,0.001\n", "column 'x5_m' is there twice"),
        ("time_s\n0\n", "has no column of a guider"),
        (HEADER, "has no usable row"),
        (HEADER + ROWS + "2.0,nan,1.0,1.0\n", "row 4: x5_mm = nan is not a finite number"),
        (HEADER + ROWS + "2.0,,1.0,1.0\n", "row 4: x5_mm = '' is not a number"),
        (HEADER + ROWS + "2.0,1.0\n", "row 4: has 2 values for 4 columns"),
        (HEADER + ROWS + "1.0,1.0,1.0,1.0\n", "row 4: time_s = 1 does not follow 1; times must increase"),
        ("time_s,x5_m\n0,12.0\n", "column x5_m reaches 12 m, but the robot is 0.25 m long; is it in another unit"),
        ("time_s,z5_mm\n0,0.25\n", "column z5_mm stays under 0.25 mm; is it in metres"),
    ],
)
def test_a_bad_recording_is_named_with_its_row_or_column(recording, text, message):
    with pytest.raises(MeasuredError, match=message):
        read_measured(recording(text), load_case("paper-simulation").parameters)


def test_bad_rows_are_left_out_only_on_request_and_counted(recording):
    path = recording(HEADER + ROWS + "1.0,1.0,1.0,1.0\n2.0,nan,1.0,1.0\n3.0,1.0,240.0,1.0\n")
    measured = read_measured(path, load_case("paper-simulation").parameters, skip_bad_rows=True)
    assert measured.skipped == 2
    assert list(measured.time_s) == [0.0, 1.0, 3.0]


def test_a_recording_of_another_time_is_refused(recording, motions):
    measured = read_measured(recording(HEADER + "20.0,0.0,250.0,0.0\n"), motions["top-00"].parameters)
    with pytest.raises(MeasuredError, match="covers 20 to 20 s, the case 0 to 10 s"):
        difference(motions["top-00"], measured)
