"""Claims about the command line: complete help, one clear line for what is wrong, and no traceback."""

import os
import socket
import subprocess
import sys

import pytest

from app.cli import COMMANDS
from app.runtime import free_port, port_holder
from cobra.loading import description_text, load_description
from cobra.mechanics.losses import described, to_text


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "app", *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, **environment},
    )


def test_help_names_every_option_and_subcommand():
    help_text = run("--help").stdout
    for word in ("--robot", "--twin", "--port", "--no-pad", "--can-log", "cobra-teleop --twin ideal", *COMMANDS):
        assert word in help_text
    assert "emergency stop" in help_text
    assert "\x1b[" not in help_text, "colours belong on a terminal only"


@pytest.mark.parametrize("command", COMMANDS)
def test_every_subcommand_has_help_with_an_example(command):
    answer = run(*command.split(), "--help")
    assert answer.returncode == 0
    assert f"cobra-teleop {command}" in answer.stdout
    assert "Examples" in answer.stdout


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("fly",), "unknown command 'fly'"),
        (("check", "nothing.toml"), "nothing.toml: cannot be read"),
        (("--robot", "nothing.toml", "--no-open"), "nothing.toml: cannot be read"),
    ],
)
def test_what_is_wrong_is_one_line(arguments, says):
    answer = run(*arguments)
    assert answer.returncode == 2
    assert says in answer.stderr
    assert len(answer.stderr.strip().splitlines()) == 1


def test_check_explains_the_robot_in_words():
    words = run("check", "cobra").stdout
    assert "8 (6 of bending, twist, feed)" in words
    assert "12 drives" not in words
    assert "14 drives" in words
    assert "assumed" in words


def test_loss_parameters_lie_beside_the_description_and_are_refused_with_the_reason_when_they_cannot_be(tmp_path):
    good = to_text(described(load_description("cobra")))
    robot, losses = tmp_path / "mine.toml", tmp_path / "losses.toml"
    robot.write_text(f'{description_text("cobra")}\n[compensation]\nparameters = "losses.toml"\n', "utf-8")
    losses.write_text(good.replace("the description", "a sweep"), "utf-8")
    assert f"Compensation: numbers from a sweep ({losses})." in run("check", str(robot)).stdout
    losses.write_text(good.replace("axial_stiffness_N = ", "axial_stiffness_N = -", 1), "utf-8")
    start = ("--robot", str(robot), "--no-open", "--no-pad", "--port", "0")
    for arguments in (("check", str(robot)), start):
        answer = run(*arguments, COBRA_TELEOP_RUNTIME_DIR=str(tmp_path))
        assert answer.returncode == 2
        reason = f"cobra-teleop: {losses}: losses.axial_stiffness_N = -10180.0: must be finite and not negative\n"
        assert answer.stderr == reason


def test_a_busy_port_names_its_holder_and_the_next_free_one_is_found():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        holder = port_holder(port)
        assert holder is not None
        assert "process" in holder
        assert free_port(port) > port


@pytest.mark.skipif(os.name != "posix", reason="pipes of POSIX")
@pytest.mark.parametrize("arguments", [("check", "cobra"), ("--help",)])
def test_whoever_reads_only_the_first_lines_of_a_table_gets_no_traceback(arguments):
    process = subprocess.Popen(
        [sys.executable, "-m", "app", *arguments], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    process.stdout.close()
    with process:
        assert process.stderr.read() == ""
