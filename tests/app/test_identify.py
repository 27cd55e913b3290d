"""`cobra-teleop identify …`: what it says and writes for load tests, motions and calibrations, and for bad input."""

import csv
import struct
import tomllib
from typing import NamedTuple

import numpy as np
import pytest

from app.cli import main
from cobra.loading import load_description
from cobra.mechanics.calibration_report import description_text
from cobra.mechanics.cases import load_case
from cobra.mechanics.friction import transmission
from tests.calibration_recordings import nominal_robot, taut, write_conventional

RNG = np.random.default_rng(1)


class Answer(NamedTuple):
    returncode: int
    stdout: str
    stderr: str


@pytest.fixture
def identify(tmp_path, monkeypatch, capsys):
    """Run the command as the command line does, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")

    def run(*arguments):
        with pytest.raises(SystemExit) as left:
            main(["identify", *map(str, arguments)])
        said = capsys.readouterr()
        return Answer(int(left.value.code or 0), said.out, said.err)

    return run


def write(path, header, rows):
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path


def is_picture(path):
    head = path.read_bytes()[:24]
    return head.startswith(b"\x89PNG\r\n\x1a\n") and struct.unpack(">I", head[16:20])[0] > 400


def bending(folder, *, spoil=None):
    rows = [
        [s, round(a, 3), round(0.1006 / 0.05 * np.radians(a) + 0.002 * RNG.standard_normal(), 5)]
        for s in range(4)
        for a in np.linspace(2.0, 30.0, 6)
    ]
    if spoil:
        spoil(rows)
    return write(folder / "bending.csv", ["set", "angle_deg", "moment_Nm"], rows)


def test_load_tests_give_the_stiffnesses_of_a_case_and_one_picture(identify, tmp_path):
    bending(tmp_path)
    twisted = [[421.2 * i, 0.1 * i] for i in range(1, 6)]
    write(tmp_path / "torsion.csv", ["moment_Nmm", "angle_rad"], twisted)
    write(tmp_path / "pull.csv", ["force_N", "elongation_mm"], [[5.136 * i, float(i)] for i in range(1, 8)])
    answer = identify(
        *("stiffness", "--bending", "bending.csv", "--torsion", "torsion.csv", "--elongation", "pull.csv"),
        *("--rest-length-mm", 50),
    )
    assert answer.returncode == 0, answer.stderr
    assert "4 sets" in answer.stdout
    robot = tomllib.loads((tmp_path / "identified" / "stiffness.toml").read_text("utf-8"))["robot"]
    assert robot["bending_stiffness_Nm2"] == pytest.approx(0.1006, rel=0.02)
    assert robot["torsional_stiffness_Nm2"] == pytest.approx(0.2106)
    assert robot["axial_stiffness_N_m"] == pytest.approx(5136.0)
    assert is_picture(tmp_path / "identified" / "stiffness.png")
    case = 'title = "x"\nduration_s = 1.0\n' + (tmp_path / "identified" / "stiffness.toml").read_text("utf-8")
    (tmp_path / "case.toml").write_text(case, encoding="utf-8")
    assert load_case(tmp_path / "case.toml").parameters.bending_stiffness_Nm2 == robot["bending_stiffness_Nm2"]


def test_motions_give_damping_and_friction(identify, tmp_path):
    time = np.arange(0.0, 3.0, 0.01)
    swing = np.degrees(0.3 * np.exp(-0.6 * time) * (np.cos(12.0 * time) + 0.05 * np.sin(12.0 * time)))
    write(
        tmp_path / "swing.csv",
        ["time_s", "angle_deg"],
        zip(time, swing + 0.02 * RNG.standard_normal(len(time)), strict=True),
    )
    answer = identify("release", "swing.csv", "--stiffness", 2.0)
    assert answer.returncode == 0, answer.stderr
    assert "damping ratio" in answer.stdout
    robot = tomllib.loads((tmp_path / "identified" / "damping.toml").read_text("utf-8"))["robot"]
    assert robot["damping_bend_Nms"] == pytest.approx(2.0 * 0.05 * 2.0 / 12.0, rel=0.05)
    slow = 0.002 * np.sin(2.0 * time * (1.0 + time))
    speed = np.gradient(slow, time)
    load = 5000.0 * slow + 80.0 * speed + 0.4 * np.sign(speed) + 0.01 * RNG.standard_normal(len(time))
    write(
        tmp_path / "pull.csv", ["time_ms", "elongation_mm", "force_N"], zip(1e3 * time, 1e3 * slow, load, strict=True)
    )
    answer = identify("sweep", "pull.csv", "--quantity", "elongation", "--out", "swept")
    assert answer.returncode == 0, answer.stderr
    robot = tomllib.loads((tmp_path / "swept" / "damping.toml").read_text("utf-8"))["robot"]
    assert robot["damping_axial_Ns_m"] == pytest.approx(80.0, rel=0.05)
    rows = []
    for i in range(40):
        bends = RNG.uniform(0.0, 18.0, 5)
        g = float(transmission(np.radians(bends), 0.12))
        rows.append([10.0, 10.0 * g if i % 2 else 10.0 / g, *bends, "in" if i % 2 else "out"])
    write(tmp_path / "tensions.csv", ["motor_N", "top_N", *(f"bend{i}_deg" for i in range(1, 6)), "moving"], rows)
    answer = identify("cable-friction", "tensions.csv")
    assert answer.returncode == 0, answer.stderr
    robot = tomllib.loads((tmp_path / "identified" / "friction.toml").read_text("utf-8"))["robot"]
    assert robot["friction"] == pytest.approx(0.12, abs=1e-4)
    for picture in ("identified/release.png", "swept/sweep.png", "identified/cable-friction.png"):
        assert is_picture(tmp_path / picture)


def set_row(i, place, value):
    def spoil(rows):
        rows[i][place] = value

    return spoil


def scaled_row(i, place, factor):
    def spoil(rows):
        rows[i][place] *= factor

    return spoil


@pytest.mark.parametrize(
    ("spoil", "arguments", "says"),
    [
        (None, (), "--rest-length-mm"),
        (None, ("--rest-length-mm", -1.0), "must be positive"),
        (set_row(3, 1, "nan"), ("--rest-length-mm", 50), "row 5: angle_deg = nan is not a finite number"),
        (set_row(3, 2, "much"), ("--rest-length-mm", 50), "row 5: moment_Nm = 'much' is not a number"),
        (
            scaled_row(9, 2, 1e3),
            ("--rest-length-mm", 50),
            "row 11: its load fits the others only when multiplied by 0.001",
        ),
    ],
)
def test_a_bad_load_test_is_one_line(identify, tmp_path, spoil, arguments, says):
    bending(tmp_path, spoil=spoil)
    answer = identify("stiffness", "--bending", "bending.csv", *arguments)
    assert answer.returncode == 2
    assert says in answer.stderr
    assert len(answer.stderr.strip().splitlines()) == 1
    assert not (tmp_path / "identified").exists()
    if spoil is not None:
        answer = identify("stiffness", "--bending", "bending.csv", *arguments, "--skip-bad-rows")
        assert answer.returncode == 0
        assert "left out row" in answer.stdout


def test_bad_motions_are_one_line(identify, tmp_path):
    time = np.arange(0.0, 3.0, 0.02)
    swing = [[f"{t:.3f}", float(10.0 * np.cos(3.0 * t))] for t in time]
    cases = {
        "row 9: time_s = 0.12 repeats row 8": lambda rows: rows[7].__setitem__(0, rows[6][0]),
        "row 12: angle_deg fits its neighbours only when multiplied by 1000": lambda rows: rows[10].__setitem__(
            1, rows[10][1] * 1e-3
        ),
    }
    for says, spoil in cases.items():
        rows = [list(row) for row in swing]
        spoil(rows)
        write(tmp_path / "swing.csv", ["time_s", "angle_deg"], rows)
        answer = identify("release", "swing.csv")
        assert answer.returncode == 2
        assert says in answer.stderr
    write(tmp_path / "swing.csv", ["time_s", "angle"], swing)
    assert "'angle_deg' or 'angle_rad' is missing; there are time_s, angle" in identify("release", "swing.csv").stderr
    write(tmp_path / "tensions.csv", ["motor_N", "top_N", "bend1_deg", "moving"], [[1.0, 1.0, 5.0, "up"]] * 4)
    assert "row 2: moving = 'up'; must be 'in'" in identify("cable-friction", "tensions.csv").stderr


def test_a_calibration_is_written_and_its_description_accepted(identify, tmp_path):
    seen = taut(60)
    write_conventional(tmp_path / "motion.csv", seen)
    (tmp_path / "mine.toml").write_text(description_text(nominal_robot()), encoding="utf-8")
    answer = identify(
        *("calibrate", "motion.csv", "--robot", "mine.toml", "--model", "plain", "--validate", "motion.csv")
    )
    assert answer.returncode == 0, answer.stderr
    for words in ("motions held out", "sections 1 and 2", "gain[t21]", "told: the data tell it", "held out motion.csv"):
        assert words in answer.stdout
    out = tmp_path / "identified"
    robot = load_description(out / "robot.toml")
    assert robot.drives[0].spool_radius_m != 0.01
    kept = tomllib.loads((out / "calibration.toml").read_text("utf-8"))
    assert kept["held_out_tip_error_m"]["sections 1"] > 0.0
    table = np.genfromtxt(out / "tips.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert table["tip_x_mm"] == pytest.approx(1e3 * seen.tip_m[:, 0], abs=1e-3)
    off = np.stack([table[f"model_{a}_mm"] - table[f"tip_{a}_mm"] for a in "xyz"], axis=-1)
    assert table["error_mm"] == pytest.approx(np.linalg.norm(off, axis=-1), abs=1e-3)
    assert kept["mean_tip_error_m"] == pytest.approx(1e-3 * table["error_mm"].mean(), rel=1e-3)
    for picture in ("tips.png", "tips-held-out.png", "parameters.png", "selection.png"):
        assert is_picture(out / picture)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--robot", "src-bot"), "src-bot: "),
        (("--robot", "cobra-twist-feed"), "cobra-twist-feed: has no tendons"),
        (("--robot", "cobra"), "column 'S1_m' or 'S1_cm' or 'S1_mm'"),
        (("--robot", "cobra", "--columns", "nothing.toml"), "nothing.toml: cannot be read"),
    ],
)
def test_a_calibration_that_cannot_begin_is_one_line(identify, tmp_path, arguments, says):
    write(tmp_path / "motion.csv", ["time_s", "tip_x_mm", "tip_y_mm", "tip_z_mm"], [[i, i, i, i] for i in range(5)])
    answer = identify("calibrate", "motion.csv", *arguments)
    assert answer.returncode == 2
    assert says in answer.stderr
    assert len(answer.stderr.strip().splitlines()) == 1
