"""A real Chromium for the tests of this folder. Without one they skip, but never in CI."""

import os
import shutil
from pathlib import Path

import pytest

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ARGUMENTS = [
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    # Without this a software-rendered plot freezes the page.
    "--disable-accelerated-2d-canvas",
    "--disable-dev-shm-usage",
]


PAD = """
(() => {
  const pad = { id: "Test Pad (STANDARD GAMEPAD)", index: 0, connected: true, mapping: "standard", timestamp: 0,
    axes: [0, 0, 0, 0], buttons: Array.from({ length: 17 }, () => ({ pressed: false, value: 0, touched: false })) };
  window.thePad = pad;
  window.press = (i, yes) => { pad.buttons[i] = { pressed: yes, value: yes ? 1 : 0, touched: yes }; };
  navigator.getGamepads = () => [window.thePad, null, null, null];
})();
"""
"""A pad that the Gamepad API shows, in a page's script: `thePad`, and `press(button, yes)`."""
NO_SCENE = "<script>parent.postMessage({ viewer: 'here' }, '*')</script>"


def without_scene(context):
    """Leave the 3D view away: drawn in software it takes the machine, and has tests of its own.

    It must answer all the same. A page whose view does not answer takes it from its own name, into its own process.
    """
    context.route("**/viewer/**", lambda route: route.fulfill(content_type="text/html", body=NO_SCENE))


def polite_chromium(folder: Path) -> str:
    """A Chromium that goes behind the program under test: it draws in software here and would starve it of the few cores.

    Where it runs as root it gives its drawing precedence over all else (-8), which it cannot do for people: that right is
    taken from it.
    """
    humble = (
        "setpriv --inh-caps=-sys_nice --bounding-set=-sys_nice " if shutil.which("setpriv") and not os.getuid() else ""
    )
    path = folder / "chromium"
    path.write_text(f'#!/bin/sh\nexec nice -n 5 {humble}{CHROMIUM} "$@"\n')
    path.chmod(0o755)
    return str(path)


@pytest.fixture(scope="session")
def chromium(tmp_path_factory):
    if CHROMIUM is None:
        if os.environ.get("CI"):
            pytest.fail("there is no Chromium in CI: .ci/run must install it")
        pytest.skip("there is no Chromium on this machine (install the package 'chromium')")
    from playwright.sync_api import expect, sync_playwright

    expect.set_options(timeout=30_000)  # for what comes, however busy the machine is
    polite = polite_chromium(tmp_path_factory.mktemp("browser"))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=polite, headless=True, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def tab(chromium):
    context = chromium.new_context(viewport={"width": 1280, "height": 720})
    context.set_default_timeout(60_000)
    yield context.new_page()
    context.close()


def pytest_collection_modifyitems(items):
    """Chromium without a GPU on two cores stalls now and then for longer than a driver may: such a test is run anew."""
    for item in items:
        if "/browser/" in item.path.as_posix():
            item.add_marker(pytest.mark.flaky(reruns=2))
