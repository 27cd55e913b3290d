"""WCAG AA of the pages' colours by computation: every pair that may meet, dark and light. What is drawn has a browser test."""

import re

import pytest

from app.console.static_folder import static_folder

PAIR = re.compile(r"--([\w-]+): light-dark\((#[0-9a-f]{6}), (#[0-9a-f]{6})\)")
PALETTE = {name: pair for name, *pair in PAIR.findall((static_folder() / "css" / "base.css").read_text())}
GROUNDS = ("bg", "panel", "raised", "hover")
WORDS = ("text", "soft", "faint", "accent", "quiet", "busy", "good", "go", "warn", "bad")


def luminance(color: str) -> float:
    """Relative luminance, 0…1, as WCAG 2.2 defines it."""
    parts = [int(color[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return sum(share * part for share, part in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def test_the_computation_is_that_of_the_standard() -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#767676", "#ffffff") == pytest.approx(4.54, abs=0.01)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_words_can_be_read_on_every_ground_and_edges_seen(theme: int) -> None:
    of = {name: pair[theme] for name, pair in PALETTE.items()}
    for ground in GROUNDS:
        for word in WORDS:
            assert contrast(of[word], of[ground]) >= 4.5, (word, ground)
    assert contrast(of["on-accent"], of["accent"]) >= 4.5
    assert contrast("#ffffff", of["stop"]) >= 4.5, "STOP"
    for seen in ("edge", "stop"):
        for ground in ("bg", "panel"):
            assert contrast(of[seen], of[ground]) >= 3.0, (seen, ground)
