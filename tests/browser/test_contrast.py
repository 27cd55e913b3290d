"""WCAG AA: every text on the page has a contrast of 4.5 to what is behind it (3 when it is large), dark and light."""

import socket
from collections.abc import Iterator
from typing import Any

import pytest

from app.console.front_door import FrontDoor
from tests.page_fakes import FakeSession

expect = pytest.importorskip("playwright.sync_api").expect

TOO_FAINT = """() => {
  const canvas = new OffscreenCanvas(1, 1).getContext("2d", { willReadFrequently: true });
  const rgba = (color) => {
    canvas.clearRect(0, 0, 1, 1);
    canvas.fillStyle = color;
    canvas.fillRect(0, 0, 1, 1);
    const [r, g, b, a] = canvas.getImageData(0, 0, 1, 1).data;
    return [r, g, b, a / 255];
  };
  const over = ([r, g, b, a], [R, G, B]) => [r * a + R * (1 - a), g * a + G * (1 - a), b * a + B * (1 - a)];
  const behind = (element) => {
    const layers = [];
    for (let e = element; e; e = e.parentElement) layers.push(rgba(getComputedStyle(e).backgroundColor));
    return layers.reverse().reduce((under, layer) => over(layer, under), rgba(getComputedStyle(document.body).backgroundColor));
  };
  const light = (c) => c.map((v) => v / 255).map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const found = [];
  let looked = 0;
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const element = texts.currentNode.parentElement;
    const text = texts.currentNode.textContent.trim();
    const style = getComputedStyle(element);
    if (!text || !element.checkVisibility({ checkOpacity: true, checkVisibilityCSS: true }) || style.display === "none") continue;
    if (element.closest("svg, noscript, iframe, script, :disabled")) continue;
    const background = behind(element);
    const [a, b] = [light(over(rgba(style.color), background)), light(background)];
    const contrast = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    const size = parseFloat(style.fontSize);
    const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    looked += 1;
    if (contrast < (large ? 3 : 4.5)) found.push(`${text.slice(0, 40)}: ${contrast.toFixed(2)}`);
  }
  return [looked, found];
}"""


@pytest.fixture
def session() -> FakeSession:
    return FakeSession()


@pytest.fixture
def door(session: FakeSession) -> Iterator[FrontDoor]:
    with socket.socket() as nobody:
        nobody.bind(("127.0.0.1", 0))
        with FrontDoor("127.0.0.1", 0, nobody.getsockname()[1], session) as door:
            yield door


@pytest.mark.parametrize("theme", ["dark", "light"])
def test_every_text_can_be_read(chromium: Any, door: FrontDoor, session: FakeSession, theme: str) -> None:
    context = chromium.new_context(viewport={"width": 1280, "height": 720}, color_scheme=theme)
    tab = context.new_page()
    tab.goto(door.url)
    expect(tab.get_by_test_id("state")).to_have_text("Ready")
    events = [
        {"level": level, "text": f"{level} for everybody", "ago": 3.0, "stamp": float(i)}
        for i, level in enumerate(("info", "warning", "alarm", "marker"))
    ]
    for phase in ("ready", "driving", "holding", "stopped", "homing", "disarmed", "fault"):
        session.changes.update(phase=phase, events=events, cause="a cause in words", reasons=["a reason"])
        expect(tab.locator("body")).to_have_attribute("data-phase", phase)
        for name in ("pad", "keys", "drives", "health", "plot", "events"):
            tab.locator(f"#tab-{name}").click()
        looked, faint = tab.evaluate(TOO_FAINT)
        assert looked > 60
        assert faint == [], f"{theme}, {phase}"
    tab.evaluate("document.getElementById('pad-dialog').showModal()")
    assert tab.evaluate(TOO_FAINT)[1] == []
    context.close()


def test_the_colours_are_chosen_on_the_page_and_kept(chromium: Any, door: FrontDoor) -> None:
    context = chromium.new_context(color_scheme="dark")
    tab = context.new_page()
    tab.goto(door.url)
    ground = "getComputedStyle(document.body).backgroundColor"
    dark = tab.evaluate(ground)
    tab.get_by_test_id("theme").click()
    assert tab.evaluate(ground) == dark
    tab.get_by_test_id("theme").click()
    light = tab.evaluate(ground)
    assert light != dark
    tab.reload()
    assert tab.evaluate(ground) == light
    context.close()
