"""The real program in a world of its own: what surrounds the robot goes to the console, and a bad mesh stops nobody."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
import tyro

from app.commands.command import SimulationArguments, as_options
from cobra.simulation.options import Simulation
from tests.stack import Page, running


def test_a_robot_in_a_pipe_tells_its_consoles_of_the_walls_and_of_what_touches(tmp_path: Path) -> None:
    with running(tmp_path, "--world", "bent-pipe", "--losses", "seeded", "--seed", "3") as stack:
        meta = stack.observer.link.meta()
        assert meta.walls
        corners = np.frombuffer(meta.walls.vertices, "<f4").reshape(-1, 3)
        assert np.frombuffer(meta.walls.faces, "<u4").max() == len(corners) - 1
        assert meta.notes == ()
        with Page(stack.url) as hands:
            hands.arm()
            hands.ask("section", 2)
            hands.drive_until(lambda: stack.observer.state.commanded[6] > 0.5, left=[1.0, 0.0])
            truth = stack.observer.truth()
            told = hands.snapshot["profiles"]
        # Along every tendon, from motor over port to the end of each section that it passes; it is lost on the way.
        for name, own, true in zip(hands.welcome["tendons"], told, truth["tension_profile"], strict=True):
            assert len(own) == 2 + int(name[1])
            assert own[0] == pytest.approx(true[0], abs=2.0)
            assert own[-1] == pytest.approx(true[len(own) - 1], abs=3.0)
        assert len(truth["contact_points"]) > 0
        assert truth["clearance_m"] < 0.001


def test_a_mesh_in_millimetres_is_named_and_the_robot_goes_on_without_it(tmp_path: Path) -> None:
    mesh = tmp_path / "engine.stl"
    trimesh.creation.box((400.0, 400.0, 40.0)).export(mesh)
    with running(tmp_path, "--world", str(mesh), "--losses", "off") as stack:
        meta = stack.observer.link.meta()
        assert meta.walls is None
        said = stack.output.read_text()
        assert f"{mesh}: 400 m across with scale 1" in said
        assert "try scale 0.001 if it is in millimetres" in said
        assert "Traceback" not in said
        with Page(stack.url) as hands:
            hands.arm()


def test_a_mesh_that_swallows_the_port_or_cannot_be_read_is_named_in_the_page_and_left_away(tmp_path: Path) -> None:
    casing, damaged = tmp_path / "casing.obj", tmp_path / "casing.glb"
    trimesh.creation.box((400.0, 400.0, 400.0)).export(casing)
    damaged.write_bytes(b"glTF, or so it says")
    pose = ("--world-scale", "0.001", "--world-pose", "0", "0", "0.15", "0", "0", "30")
    for mesh, more, says in ((casing, pose, "swallows the entry port"), (damaged, (), "damaged, or no GLB")):
        folder = tmp_path / mesh.suffix
        folder.mkdir()
        with running(folder, "--world", str(mesh), *more) as stack, Page(stack.url) as hands:
            assert stack.observer.link.meta().walls is None
            (event,) = [event for event in hands.snapshot["events"] if str(mesh) in event["text"]]
            assert event["level"] == "warning"
            assert says in event["text"]
            assert event["text"].endswith("going on in free space")
            assert "Traceback" not in stack.output.read_text()


def test_the_robot_process_is_started_with_the_options_that_the_console_got() -> None:
    arguments = SimulationArguments(
        losses="nominal",
        seed=7,
        world="engine-stage",
        world_scale=0.5,
        world_pose=(0.1, -0.2, 0.3, 10.0, -20.0, 30.0),
        payload=0.01,
        gravity=(0.0, -9.81, 0.0),
    )
    said = as_options(arguments.simulation())
    assert tyro.cli(SimulationArguments, args=list(said)).simulation() == arguments.simulation()
    assert tyro.cli(SimulationArguments, args=list(as_options(Simulation()))).simulation() == Simulation()
