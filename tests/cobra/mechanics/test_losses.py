"""Claims about files of loss parameters: what was written comes back, and what cannot be is refused with the reason."""

from dataclasses import fields, replace

import numpy as np
import pytest

from cobra.loading import load_description
from cobra.mechanics.losses import Losses, LossesError, described, from_text, load, to_text

COBRA = load_description("cobra")
TEXT = to_text(described(COBRA))


def refused(text: str) -> str:
    with pytest.raises(LossesError) as caught:
        from_text(text, COBRA, "mine.toml")
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert "\n" not in message
    return message.removeprefix("mine.toml: ")


def changed(name: str, value: str, table: str = "losses") -> str:
    """The file with another value for one of its keys."""
    head, mark, tail = TEXT.partition(f"[{table}]")
    line = next(line for line in tail.splitlines() if line.startswith(f"{name} = "))
    return head + mark + tail.replace(line, f"{name} = {value}", 1)


def test_what_was_written_comes_back():
    back, wrote = from_text(TEXT, COBRA, "mine.toml"), described(COBRA)
    assert back.source == wrote.source
    for part in ("losses", "deviation"):
        for field in fields(Losses):
            np.testing.assert_array_equal(
                getattr(getattr(back, part), field.name), getattr(getattr(wrote, part), field.name)
            )


@pytest.mark.parametrize(
    ("name", "value", "says"),
    [
        ("axial_stiffness_N", "0.0", ["axial_stiffness_N = 0.0", "greater than 0"]),
        ("axial_stiffness_N", "-10180.0", ["axial_stiffness_N = -10180.0", "not negative"]),
        ("axial_stiffness_N", "1e7", ["axial_stiffness_N = 1e+07", "0.36 mm", "to 1.22e+05 N"]),
        ("axial_stiffness_N", "nan", ["axial_stiffness_N = nan", "finite"]),
        ("axial_stiffness_N", "inf", ["axial_stiffness_N = inf", "finite"]),
        ("axial_stiffness_N", "true", ["axial_stiffness_N = True", "must be numbers"]),
        ("axial_stiffness_N", '"stiff"', ["'stiff'", "must be numbers"]),
        ("hole_friction", "-0.1", ["hole_friction = -0.1", "not negative"]),
        ("hole_friction", "1.4", ["hole_friction = 1.4", "at most 1"]),
        ("conduit_capstan", "9.0", ["conduit_capstan = 9", "exp(9.0)", "at most 3"]),
        ("radius_m", "[0.0033, 0.0, 0.0033]", ["radius_m", "greater than 0"]),
        ("radius_m", "[0.0033, 0.0033, 0.0051]", ["radius_m", "at most 0.0045", "half of its diameter"]),
        ("radius_m", "[0.0033, 0.0033]", ["2 numbers for 3", "another robot"]),
        ("bending_stiffness_Nm2", "[0.01, 0.01, -0.01]", ["bending_stiffness_Nm2", "not negative"]),
        ("settling_s", "nan", ["settling_s = nan", "finite"]),
    ],
)
def test_a_number_that_cannot_be_is_refused_with_its_key_and_the_reason(name, value, says):
    message = refused(changed(name, value))
    for part in ("losses", *says):
        assert part in message


def test_deviations_are_looked_at_too():
    assert "deviation.hole_friction = -1.0" in refused(changed("hole_friction", "-1.0", table="deviation"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("losses = = 3", "not valid TOML"),
        ("", "losses: missing; write the file with `cobra-teleop identify friction --out FILE`"),
        (TEXT.replace("hole_friction", "hole_frction", 1), "losses: unknown key 'hole_frction'; there are axial"),
        (TEXT.replace("[deviation]", "[spread]"), "unknown key 'spread'; there are source, losses, deviation"),
        (TEXT.replace("settling_s", "# settling_s", 1), "losses.settling_s: missing"),
        ("losses = 3\ndeviation = 4", "losses: missing"),
    ],
)
def test_a_file_that_is_no_file_of_losses_is_refused(text, says):
    assert says in refused(text)


def test_a_file_that_cannot_be_read_says_how_to_make_one(tmp_path):
    with pytest.raises(LossesError, match=r"nothing\.toml: cannot be read .*identify friction --out"):
        load(tmp_path / "nothing.toml", COBRA)
    (tmp_path / "noise.toml").write_bytes(bytes(range(128, 256)))
    with pytest.raises(LossesError, match=r"noise\.toml: cannot be read"):
        load(tmp_path / "noise.toml", COBRA)


def test_what_the_sweep_may_find_is_plausible():
    """As far as identification may go from the description, its own file must be accepted."""
    known = described(COBRA)
    for share in (0.55, 1.25):
        losses = replace(known.losses, axial_stiffness_N=share * known.losses.axial_stiffness_N)
        assert from_text(to_text(replace(known, losses=losses)), COBRA, "mine.toml").losses.axial_stiffness_N > 0
