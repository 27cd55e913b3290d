"""`cobra-teleop identify friction` as people start it: its own robot process in real time, a twin that is not as described."""

import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from cobra.loading import load_description
from cobra.mechanics.losses import Losses, load
from cobra.simulation.losses import with_losses
from tests.stack import wait_for

pytestmark = pytest.mark.long
SEED = 3
COMMAND = (sys.executable, "-m", "app", "identify", "friction", "--losses", "seeded", "--seed", str(SEED))
FOUND_WITHIN = {"axial_stiffness_N": 0.05, "hole_friction": 0.15, "conduit_capstan": 0.1, "bending_stiffness_Nm2": 0.2}
"""Of the truth, which is up to 30 % from what is described."""


@pytest.mark.timeout(600)
def test_what_the_sweep_reports_is_what_the_twin_has(tmp_path: Path) -> None:
    out = tmp_path / "losses.toml"
    done = subprocess.run([*COMMAND, "--out", str(out)], capture_output=True, text=True, timeout=500, check=False)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
    print(done.stdout)
    description = load_description("cobra")
    found, true = load(out, description).losses, Losses.described(with_losses(description, "seeded", SEED))
    nominal = Losses.described(description)
    for name, share in FOUND_WITHIN.items():
        truth = np.atleast_1d(getattr(true, name))
        off = np.abs(np.atleast_1d(getattr(found, name)) / truth - 1.0).max()
        print(
            f"{name}: {off:.1%} off, described {np.abs(np.atleast_1d(getattr(nominal, name)) / truth - 1.0).max():.0%}"
        )
        assert off < share, name
    assert "tendon stiffness EA" in done.stdout


def test_who_drives_already_is_named_and_ctrl_c_ends_it_without_a_traceback() -> None:
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as first:
        lines: list[str] = []
        assert first.stdout is not None
        reader = threading.Thread(target=lambda: lines.extend(iter(first.stdout.readline, "")), daemon=True)
        reader.start()
        wait_for("the sweep", lambda: any("sweeping for" in line for line in lines), 120.0)
        second = subprocess.run(COMMAND, capture_output=True, text=True, timeout=60, check=False)
        assert second.returncode == 2
        assert second.stderr == "cobra-teleop: identify friction drives: let them release the controls first\n"
        first.send_signal(signal.SIGINT)
        assert first.wait(30) == 130
        reader.join()
        assert first.stderr is not None
        assert first.stderr.read() == ""
