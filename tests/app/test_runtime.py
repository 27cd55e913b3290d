"""Who runs on this machine: entries of processes that are gone count for nothing."""

import subprocess
import sys

import msgspec
import psutil
import pytest

from app import runtime


@pytest.mark.skipif(sys.platform == "win32", reason="processes that nobody has waited for are POSIX's")
def test_a_killed_process_that_nobody_waited_for_yet_is_gone(tmp_path, monkeypatch):
    monkeypatch.setenv("COBRA_TELEOP_RUNTIME_DIR", str(tmp_path))
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as process:
        entry = runtime.Running(
            pid=process.pid,
            endpoint="tcp/127.0.0.1:1",
            robot="cobra",
            started=psutil.Process(process.pid).create_time(),
        )
        (tmp_path / "robot-cobra.json").write_bytes(msgspec.json.encode(entry))
        assert runtime.find("robot", "cobra") == entry
        process.kill()
        while psutil.Process(process.pid).status() != psutil.STATUS_ZOMBIE:
            pass
        assert runtime.find("robot", "cobra") is None
