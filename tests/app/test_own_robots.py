"""Robots that somebody brings: written as TOML, explained by `check`, homed and driven in every mode on their twins."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest

from app.check import explain
from cobra.kinematics.backbone import Backbone
from cobra.loading import DescriptionError, description_text, parse_description
from cobra.messages import Intent
from cobra.simulation.drives import world_of
from tests.bench import Bench

HEAD = """name = "own"
title = "Own robot"
[backbone]
total_length_m = 5.0
diameter_m = 0.009
mass_per_length_kg_m = 0.04
gravity_m_s2 = [0.0, 0.0, 9.81]
"""
SECTION = """[[sections]]
name = "{name}"
length_m = {length}
max_bend_deg = {bend}
vertebrae = {vertebrae}
vertebra_thickness_m = 0.0091
bending_stiffness_Nm2 = 0.0012
torsional_stiffness_Nm2 = 0.05
"""
ROUTING = """[sections.routing]
names = [{names}]
azimuths_deg = {azimuths}
radius_m = 0.0033
"""
DRIVE = """[[drives]]
name = "{name}"
moves = "tendon"
tendon = "{name}"
motor = "small"
bus = "main"
address = {address}
spool_radius_m = 0.010
travel_range = [-0.060, 0.040]
"""


def own_robot(*sections: tuple[float, ...] | None, lengths_m: tuple[float, ...] = ()) -> str:
    """TOML of a robot; each section by the azimuths of its tendons, None for a passive one. Materials as COBRA's."""
    text, tendons = [HEAD], []
    for i, azimuths in enumerate(sections):
        length = lengths_m[i] if lengths_m else 0.08 if azimuths else 0.07
        text.append(
            SECTION.format(name=f"s{i}", length=length, bend=round(length * 870), vertebrae=round(length / 0.01))
        )
        if azimuths:
            names = [f"{'ABCDEF'[k]}{i}" for k in range(len(azimuths))]
            text.append(ROUTING.format(names=", ".join(f'"{name}"' for name in names), azimuths=list(azimuths)))
            tendons += names
    preset = description_text("cobra-active")
    text.append(preset[preset.index("[tendon]") : preset.index("[[drives]]")])
    text += [DRIVE.format(name=name, address=k + 1) for k, name in enumerate(tendons)]
    return "\n".join(text)


def around(count: int, first: float = 0.0) -> tuple[float, ...]:
    return tuple(round(first + 360.0 * k / count, 3) for k in range(count))


THREE, UNEQUAL = "two sections of three tendons", "two sections, the first half as long as the second"
FIVE, PASSIVE = "five sections of four tendons", "a passive section between active ones"
OWN = {
    THREE: (own_robot((10.0, 140.0, 250.0), around(3, 70.0)), 4, 6),
    UNEQUAL: (own_robot((10.0, 140.0, 250.0), around(4, 70.0), lengths_m=(0.06, 0.12)), 4, 7),
    FIVE: (own_robot(*(around(4, 18.0 * i) for i in range(5))), 10, 20),
    PASSIVE: (own_robot(around(4), None, around(3, 45.0)), 4, 7),
}


@pytest.mark.parametrize("name", OWN)
def test_check_explains_it_in_words(tmp_path, name):
    text, freedom, tendons = OWN[name]
    robot = parse_description(text, "own.toml")
    told = "\n".join(explain(robot))
    assert f"Degrees of freedom: {freedom}" in told
    for section in robot.sections:
        kind = f"{len(section.routing.names)} tendons" if section.routing else "passive"
        assert f"Section {section.name}: {section.length_m * 1e3:.0f} mm" in told
        assert kind in told
    assert f"{tendons} drives" in told
    assert "busy at 100 Hz" in told
    aside = float(told.split("shapes: ")[1].split(" mm aside")[0])
    assert 0.3 * robot.active_length_m < aside * 1e-3 < robot.active_length_m


@pytest.mark.parametrize(
    ("name", "twin", "off"),
    [
        (THREE, "default", 0.1),
        (THREE, "ideal", 0.05),
        (UNEQUAL, "ideal", 0.05),
        (FIVE, "default", 0.1),
        # A passive section bends a little with what passes through it, which the kinematics does not know.
        (PASSIVE, "default", 0.25),
    ],
)
def test_it_is_homed_and_driven_on_its_twin(name, twin, off):
    """Bend the first and the last section, move the tip, and straighten: the twin is where the kinematics says."""
    robot = parse_description(OWN[name][0], "own.toml")
    backbone = Backbone(robot)
    with Bench(seed=1, robot="own", twin=twin, description=robot) as bench:
        assert bench.home().phase == "ready"

        def drive(mode: str, seconds: float, **intent: object) -> None:
            bench.mode = mode
            for _ in range(40):
                bench.tick()
            bench.tick(Intent())
            for _ in range(round(seconds / bench.loop.period_s)):
                bench.tick(Intent(**intent))
            for _ in range(60):
                state = bench.tick()
            assert state.phase == "ready", state.cause

        start = world_of("own#main").truth().tip_position.copy()
        drive("section", 0.9, primary=(1.0, 0.0), secondary=(0.0, -1.0), section=robot.active_sections[0])
        drive("tip", 0.6, primary=(0.0, -0.4))
        q = np.array(bench.states[-1].measured)
        moved = world_of("own#main").truth().tip_position - start
        model = backbone.tip(q)[:3, 3] - backbone.tip(backbone.configuration.rest())[:3, 3]
        print(
            f"{name}, {twin} twin: the tip moved {1e3 * np.linalg.norm(moved):.1f} mm, {1e3 * np.linalg.norm(moved - model):.1f} mm off"
        )
        assert moved[0] > 0.01
        assert moved[1] < -0.005
        assert np.linalg.norm(moved - model) < off * np.linalg.norm(model)
        drive("straighten", 3.0)
        assert max(math.hypot(*bench.loop.motion.q[where]) for where in backbone.configuration.bends) < 1e-6
        assert np.linalg.norm(world_of("own#main").truth().tip_position - start) < 0.01


def test_a_length_outside_its_own_range_is_refused_with_the_reason():
    text = re.sub(r"\nrange_m = \[[^]]*\]", r"\nrange_m = [0.26, 0.28]", description_text("src-bot"))
    with pytest.raises(DescriptionError, match=r"length_m = 0.25: must lie in elongation.range_m = \[0.26, 0.28\]"):
        parse_description(text, "own.toml")


def test_a_robot_is_fed_by_a_drive_or_by_hand_not_both():
    text = description_text("cobra").replace('title = "', 'hand_fed = true\ntitle = "', 1)
    with pytest.raises(DescriptionError, match="a drive or a hand, not both"):
        parse_description(text, "own.toml")


def test_the_command_explains_a_file_and_says_in_one_line_what_is_wrong(tmp_path):
    good, bad = tmp_path / "own.toml", tmp_path / "bad.toml"
    good.write_text(OWN["two sections of three tendons"][0])
    bad.write_text(good.read_text().replace('tendon = "A0"', 'tendon = "A9"'))

    def check(path):
        command = [sys.executable, "-m", "app", "check", str(path)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    assert "Degrees of freedom: 4" in check(good).stdout
    refused = check(bad)
    assert refused.returncode == 2
    assert refused.stderr.count("\n") == 1
    assert "A9" in refused.stderr
