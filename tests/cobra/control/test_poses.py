"""Claims about saved poses: kept whole on disk, never mixed up with another robot's, and honest when they cannot be kept."""

import json
import threading

import numpy as np
import pytest

from cobra.control.poses import MOST, PoseBook
from cobra.loading import load_description
from cobra.messages import Request
from tests.obedient_bus import ObedientRobot

COBRA = load_description("cobra")
Q = np.array([0.1, 0.3, 0.2, -0.1, 0.3, 0.0, 0.1, 0.4])


def book(path, complaints=None):
    poses = PoseBook(COBRA, path, (complaints if complaints is not None else []).append)
    poses.start()
    return poses


def test_a_pose_is_there_again_for_the_next_process(tmp_path):
    path = tmp_path / "deep" / "cobra.json"
    first = book(path)
    assert first.save("inspect blade 3", Q) == ""
    assert first.save("home", 0 * Q) == ""
    assert first.delete("home") == ""
    first.stop()
    again = book(path)
    assert list(again) == ["inspect blade 3"]
    np.testing.assert_array_equal(again["inspect blade 3"], Q)
    again.stop()
    assert [entry.name for entry in path.parent.iterdir()] == ["cobra.json"]


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text[: len(text) // 2],
        lambda text: text.replace("0.4", "1e999"),
        lambda text: text.replace('"tip y"', '"tip length"'),
        lambda text: text.replace("0.1,", "", 1),
    ],
)
def test_a_file_that_is_damaged_or_another_robots_is_told_of_and_left_alone(tmp_path, damage):
    path = tmp_path / "cobra.json"
    first = book(path)
    first.save("inspect", Q)
    first.stop()
    damaged = damage(path.read_text())
    assert damaged != path.read_text()
    path.write_text(damaged)
    complaints = []
    again = book(path, complaints)
    assert len(again) == 0
    assert len(complaints) == 1
    assert str(path) in complaints[0]
    assert again.save("other", Q) == ""
    again.stop()
    assert path.read_text() == damaged


def test_a_disk_that_does_not_take_it_is_complained_of_and_the_pose_stays_usable(tmp_path):
    (tmp_path / "poses").write_text("a file where the folder would be")
    told = threading.Event()
    complaints = []
    poses = PoseBook(COBRA, tmp_path / "poses" / "cobra.json", lambda text: (complaints.append(text), told.set()))
    poses.start()
    poses.save("inspect", Q)
    assert told.wait(10.0)
    poses.stop()
    assert complaints
    assert "inspect" in poses


@pytest.mark.parametrize("name", ["", " ", "../../etc/passwd", "a/b", "x" * 41, "-rf", "a\nb"])
def test_names_that_are_no_names_are_refused_in_words(name):
    refusal = PoseBook(COBRA).save(name, Q)
    assert "cannot be named" in refusal


def test_there_is_an_end_to_the_list():
    poses = PoseBook(COBRA)
    for i in range(MOST):
        assert poses.save(f"pose {i}", Q) == ""
    assert "delete one first" in poses.save("one more", Q)
    assert poses.save("pose 3", 0 * Q) == "", "an old name may be used anew"


def test_poses_are_saved_and_deleted_at_rest_only_and_after_homing():
    robot = ObedientRobot(COBRA, Q)

    def ask(what):
        return robot.ask(Request(what=what, name="inspect", lease=robot.lease))

    robot.press("section")
    assert ask("save_pose").reasons == ("let go first: the robot is being driven",)
    robot.tick()
    assert ask("save_pose").ok
    np.testing.assert_allclose(robot.loop.motion._poses["inspect"], Q, atol=1e-12)
    assert ask("delete_pose").ok
    assert ask("delete_pose").reasons == ("there is no pose 'inspect'",)
    robot.loop.supervisor.homed = False
    assert "not known before homing" in ask("save_pose").reasons[0]


def test_the_file_says_what_its_numbers_are(tmp_path):
    poses = book(tmp_path / "cobra.json")
    poses.save("inspect", Q)
    poses.stop()
    kept = json.loads((tmp_path / "cobra.json").read_text())
    assert dict(zip(kept["entries"], kept["poses"]["inspect"], strict=True))["tip y"] == 0.4
