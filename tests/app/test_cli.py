"""Claims about the command line: complete help, one clear line for what is wrong, and no traceback."""

import socket
import subprocess
import sys

import pytest

from app.cli import COMMANDS
from app.runtime import free_port, port_holder


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "app", *arguments], capture_output=True, text=True, timeout=60, check=False
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


def test_a_busy_port_names_its_holder_and_the_next_free_one_is_found():
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        holder = port_holder(port)
        assert holder is not None
        assert "process" in holder
        assert free_port(port) > port
