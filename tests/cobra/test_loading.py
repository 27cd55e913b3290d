"""Claims about robot descriptions: what is wrong is told in one line with file, key, value and what is allowed."""

import math

import pytest

from cobra.loading import DescriptionError, assumed_numbers, description_text, load_description, robot_names

TEXT = description_text("cobra")


def broken(tmp_path, old: str, new: str) -> str:
    assert old in TEXT, f"the description no longer says {old!r}"
    path = tmp_path / "robot.toml"
    path.write_text(TEXT.replace(old, new, 1), "utf-8")
    with pytest.raises(DescriptionError) as caught:
        load_description(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


@pytest.mark.parametrize("name", robot_names())
def test_every_robot_that_comes_with_the_program_loads(name):
    assert load_description(name).name == name


def test_cobra_is_what_the_paper_describes():
    cobra = load_description("cobra")
    assert len(cobra.sections) == 3
    assert len(cobra.tendon_names) == 12
    assert len(cobra.drives) == 14
    assert cobra.twist is not None
    assert cobra.feed is not None
    first, second, third = (section.routing for section in cobra.sections)
    assert first
    assert second
    assert third
    # S, E, N, W as antagonists, and 30 degrees more in every section (C-4).
    assert first.azimuths_deg == (90.0, 0.0, 270.0, 180.0)
    for a, b in ((first, second), (second, third)):
        assert [y - x for x, y in zip(a.azimuths_deg, b.azimuths_deg, strict=True)] == [30.0] * 4
    assert cobra.backbone.total_length_m == 5.0
    assert cobra.backbone.diameter_m == 0.009


def test_only_what_has_a_source_is_not_assumed():
    assumed = assumed_numbers(load_description("cobra"))
    assert "backbone.total_length_m" not in assumed
    assert "backbone.diameter_m" not in assumed
    assert "sections[0].length_m" in assumed
    assert "tendon.axial_stiffness_N" in assumed
    assert "drives[13].spool_radius_m" in assumed


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("length_m = 0.100", 'length_m = "long"', ["sections[0].length_m", "'long'", "float"]),
        ("vertebrae = 10", "vertebrae = 1", ["sections[0].vertebrae = 1", ">= 2"]),
        ("radius_m = 0.0033", "radiusm = 0.0033", ["sections[0].routing.radiusm", "unknown key", "radius_m"]),
        ("radius_m = 0.0033", "radius_m = 0.0050", ["sections[0].routing.radius_m = 0.005", "half"]),
        ('title = "COBRA"', 'titel = "COBRA"', ["titel", "unknown key", "title"]),
        ("[tendon] ", "[tendons] ", ["tendons", "unknown key", "tendon"]),
        ("gear_ratio = 9.0", "gear_ratio = -9.0", ["motors[0].gear_ratio = -9.0", "> 0"]),
        ("gear_ratio = 9.0", "gear_ratio = inf", ["motors[0].gear_ratio = inf", "finite"]),
        ('protocol = "rmd-v1"', 'protocol = "rmd"', ["motors[0].protocol = 'rmd'", "rmd-v1", "rmd-v3", "cia402"]),
        ('tendon = "S1"', 'tendon = "S9"', ["drives[0].tendon = 'S9'", "no such tendon", "S1"]),
        ('tendon = "S1"', 'tendon = "E1"', ["drives[1].tendon = 'E1'", "already"]),
        ("address = 2\n", "address = 1\n", ["drives[1].address = 1", "'E1'", "'S1'", "'main'"]),
        ("address = 14\n", "address = 40\n", ["drives[13].address = 40", "1 to 32"]),
        ('motor = "small"', 'motor = "large"', ["drives[0].motor = 'large'", "small"]),
        ('bus = "main"', 'bus = "other"', ["drives[0].bus = 'other'", "main"]),
        ("range_m = [0.0, 1.0]", "range_m = [1.0, 0.0]", ["feed.range_m = [1.0, 0.0]", "under"]),
        ("range_m = [0.0, 1.0]", "range_m = [0.0, 9.0]", ["feed.range_m", "5.0"]),
        ("start_m = 0.30", "start_m = 2.0", ["feed.start_m = 2.0", "[0.0, 1.0]"]),
        ("min_tension_N = 0.5", "min_tension_N = 50.5", ["tendon.pretension_N", "min_tension_N = 50.5"]),
        ("total_length_m = 5.0", "total_length_m = 0.2", ["backbone.total_length_m = 0.2", "0.3 m"]),
        ("azimuths_deg = [90.0, 0.0, 270.0, 180.0]", "azimuths_deg = [90.0, 0.0]", ["azimuths_deg", "4 names"]),
        ("azimuths_deg = [90.0, 0.0, 270.0, 180.0]", "azimuths_deg = [9.0, 0.0, 20.0, 80.0]", ["surround"]),
        ('"backbone.diameter_m" =', '"backbone.thickness_m" =', ["backbone.thickness_m", "no number"]),
        ('name = "cobra"', "", ["name", "missing"]),
    ],
)
def test_a_mistake_is_told_in_one_line(tmp_path, old, new, says):
    message = broken(tmp_path, old, new)
    for part in says:
        assert part in message


def test_a_missing_tendon_is_named(tmp_path):
    message = broken(tmp_path, 'moves = "tendon"\ntendon = "W3"', 'moves = "twist"\nreduction = 1.0')
    assert message.startswith("drives[11].spool_radius_m")
    start = TEXT.index('[[drives]]\nname = "W3"')
    path = tmp_path / "robot.toml"
    path.write_text(TEXT[:start] + TEXT[TEXT.index("[[drives]]", start + 1) :], "utf-8")
    with pytest.raises(DescriptionError, match="tendon 'W3' is missing"):
        load_description(path)


def test_a_file_that_is_not_there_or_not_toml_is_told(tmp_path):
    with pytest.raises(DescriptionError, match=r"cannot be read.*cobra"):
        load_description(tmp_path / "nothing.toml")
    path = tmp_path / "robot.toml"
    path.write_text("name = = 3", "utf-8")
    with pytest.raises(DescriptionError, match="not valid TOML"):
        load_description(path)


def test_travel_per_radian_carries_direction_and_gear():
    cobra = load_description("cobra")
    by_name = {drive.name: drive for drive in cobra.drives}
    assert by_name["S1"].travel_per_rad == pytest.approx(0.010)
    assert by_name["twist"].travel_per_rad == pytest.approx(0.25)
    assert by_name["twist"].travel_limits == pytest.approx((-math.pi, math.pi))


def test_a_bend_that_the_vertebrae_cannot_make_is_refused(tmp_path):
    message = broken(tmp_path, "max_bend_deg = 90.0", "max_bend_deg = 170.0")
    assert "sections[0].max_bend_deg = 170" in message
    assert "meet at" in message
