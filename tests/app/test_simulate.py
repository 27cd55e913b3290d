"""`cobra-teleop simulate`: what it writes, what it says beside the paper's numbers, and its replay in 3D."""

import io
import struct

import numpy as np
import pytest
from rich.console import Console

from app.simulate import SimulateOptions, run_simulation
from app.simulate_figures import deflection_figure, motion_figure, trajectory_figure
from app.simulate_view import MotionView, draw
from cobra.errors import OperatorError
from cobra.mechanics.cases import load_case
from cobra.mechanics.chain import cable_lengths
from cobra.mechanics.dynamics import simulate
from cobra.mechanics.measured import read_measured

SHORT = """
title = "A short case in space"
duration_s = 0.5
[[cables]]
cable = 2
time_s = [0.0]
force_N = [6.0]
[[loads]]
guider = 5
time_s = [0.2]
force_N = [[0.5, 0.0, 0.0]]
"""


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(SHORT, encoding="utf-8")
    return load_case(path)


@pytest.fixture
def motion(case):
    return simulate(case.parameters, case.file.duration_s, case.cables, case.loads)


def run(**options):
    """Exit status and what it printed."""
    output = io.StringIO()
    status = run_simulation(SimulateOptions(**options), Console(file=output, width=140))
    return status, output.getvalue()


def png_size(path):
    head = path.read_bytes()[:24]
    assert head.startswith(b"\x89PNG\r\n\x1a\n")
    return struct.unpack(">II", head[16:24])


def test_data_and_pictures_are_written_and_say_what_was_simulated(tmp_path, case, motion):
    status, said = run(case=str(tmp_path / "short.toml"), out=tmp_path / "out")
    assert status == 0
    assert "A short case in space" in said
    written = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert written == ["deflection.png", "motion.csv", "motion.npz", "motion.png", "trajectories.png"]
    for name in written:
        assert str(tmp_path / "out" / name) in said.replace("\n", "")
    data = np.load(tmp_path / "out" / "motion.npz")
    assert data["positions_m"] == pytest.approx(motion.positions_m, abs=1e-12)
    assert str(data["case"]) == SHORT
    table = np.genfromtxt(tmp_path / "out" / "motion.csv", delimiter=",", names=True)
    assert table["x5_m"] == pytest.approx(motion.positions_m[:, 5, 0], abs=1e-9)
    assert table["tilt_y3_deg"] == pytest.approx(np.degrees(motion.tilt_rad[:, 3, 1]), abs=1e-6)
    assert table["cable2_length_m"] == pytest.approx(cable_lengths(case.parameters, motion.q)[:, 1], abs=1e-9)
    assert table["load_x5_N"][-1] == 0.5
    for picture in ("motion", "trajectories", "deflection"):
        width, height = png_size(tmp_path / "out" / f"{picture}.png")
        assert width > 800
        assert height > 400


def test_what_it_wrote_laid_over_itself_has_no_error(tmp_path):
    path = str(tmp_path / "short.toml")
    (tmp_path / "short.toml").write_text(SHORT, encoding="utf-8")
    run(case=path, out=tmp_path / "out", pictures=False)
    status, said = run(case=path, out=tmp_path / "out", pictures=False, measured=tmp_path / "out" / "motion.csv")
    assert status == 0
    lines = [line for line in said[said.index("Measured minus simulated") :].splitlines() if line.startswith("│")]
    assert len(lines) == 25, "three positions and two tilts of five guiders"
    assert all(line.count("0.00") == 4 for line in lines)


def test_the_papers_bands_stand_beside_the_prediction_labelled_as_what_they_are(tmp_path):
    _, said = run(case="top-30", out=tmp_path, pictures=False)
    assert "the error the paper reports between its own model and its robot" in said
    assert "The bands are not the error of this prediction" in said
    assert "-9.7 … 9.7 mm" in said
    assert "-3 … 7.5 °" in said
    assert "Assumed, because the paper's text does not give them: rest_length_m" in said
    assert "bending_stiffness_Nm2" not in said


def test_the_published_form_and_an_adaptive_step_can_be_asked_for(tmp_path):
    _, published = run(case="paper-simulation", out=tmp_path, pictures=False, formulation="published")
    assert "(paper-simulation, published)" in published
    _, fixed = run(case="paper-simulation", out=tmp_path, pictures=False, step_ms=0.5)
    assert "30000 steps" in fixed
    assert "Chamber 2 locked at 5.04 s." in fixed
    _, adaptive = run(case="paper-simulation", out=tmp_path, pictures=False, tolerance_mm=0.01)
    assert "30000 steps" not in adaptive


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"case": "nowhere.toml"}, "nowhere.toml: cannot be read"),
        ({"case": "top-30", "formulation": "published", "tolerance_mm": 0.1}, "published equations take a fixed step"),
        ({"case": "top-30", "step_ms": -1.0}, "top-30: step_s = -0.001: must be positive"),
        ({"case": "top-30", "tolerance_mm": -1.0}, "top-30: tolerance_m = -0.001: must be positive"),
        ({"case": "top-30", "step_ms": 1e-6}, "top-30: step_s = 1e-09: must be at least 1e-06"),
    ],
)
def test_what_cannot_be_done_is_one_line(tmp_path, options, message):
    with pytest.raises(OperatorError, match=message) as caught:
        run(out=tmp_path, pictures=False, **options)
    assert "\n" not in str(caught.value)


def test_a_folder_that_cannot_be_written_is_said(tmp_path):
    (tmp_path / "taken").write_text("", encoding="utf-8")
    with pytest.raises(OperatorError, match=r"taken: cannot be written .*; choose another --out"):
        run(case="top-30", out=tmp_path / "taken", pictures=False)


def test_pictures_show_every_guider_and_the_measured_motion_over_them(tmp_path, case, motion):
    track = tmp_path / "track.csv"
    track.write_text("time_s,x5_mm,y5_mm,z5_mm,tilt_x5_deg\n0.0,0,0,250,0\n0.4,-5,10,245,-2\n", encoding="utf-8")
    measured = read_measured(track, case.parameters)
    figure = motion_figure(case, motion, measured)
    positions = next(axes for axes in figure.axes if axes.get_ylabel() == "x [mm]" and not hasattr(axes, "get_zlabel"))
    drawn = [line.get_ydata() for line in positions.lines]
    assert any(np.array_equal(line, 1e3 * motion.positions_m[:, 5, 0]) for line in drawn)
    assert any(np.array_equal(line, [0.0, -5.0]) for line in drawn)
    errors = trajectory_figure(case, motion, measured).axes
    assert {"position, measured against simulated [mm]", "tilt, measured against simulated [°]"} <= {
        axes.get_ylabel() for axes in errors
    }
    before_and_after = deflection_figure(case, motion, measured, 0.2).axes[1]
    ends = [line.get_ydata() for line in before_and_after.lines]
    assert any(np.array_equal(line, 1e3 * motion.positions_m[-1, 1:, 0]) for line in ends)


def test_the_view_draws_the_moment_of_its_slider_and_plays_on(motion):
    view = MotionView(motion)
    view.start()
    try:
        assert view.port > 0
        view.playing.value = False
        view.slider.value = 0.3
        view.step(1.0)
        assert view.slider.value == 0.3
        now = draw(motion, 0.3)
        row = int(np.abs(motion.time_s - 0.3).argmin())
        assert now.guiders == pytest.approx(motion.positions_m[row])
        assert view._guiders.batched_positions == pytest.approx(now.guiders.astype(np.float32), abs=1e-6)
        assert view._loads.points[4, 1] == pytest.approx(now.guiders[5], abs=1e-6)
        view.playing.value = True
        view.speed.value = "0.5"
        view.step(0.1)
        assert view.slider.value == pytest.approx(0.35)
        view.step(1.0)
        assert view.slider.value == 0.0, "after the end it begins anew"
    finally:
        view.stop()


def test_drawn_cables_are_as_long_as_the_model_says(motion):
    """Between guiders they run straight; along the arcs, which S-8 measures, they are a little longer."""
    drawn = draw(motion, 0.5)
    pieces = np.linalg.norm(drawn.cables[:, 1] - drawn.cables[:, 0], axis=-1).reshape(3, 5).sum(axis=1)
    assert pieces == pytest.approx(motion.cable_lengths_m[-1], rel=5e-3)
    assert drawn.tensions.reshape(3, 5)[:, 0] == pytest.approx(motion.tensions_N[-1])
