"""Make the README's picture from the running program:  python -m tests.screenshot docs/operator-page.png"""

import sys
import tempfile
from pathlib import Path

from playwright.sync_api import sync_playwright

from tests.browser.conftest import ARGUMENTS, CHROMIUM
from tests.stack import Page, running

SIZE = {"width": 1440, "height": 900}


def main(picture: Path) -> None:
    """Bend all three sections, then photograph the operator's page."""
    if CHROMIUM is None:
        raise SystemExit("there is no Chromium on this machine (install the package 'chromium')")
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Path(folder), "--frame-rate", "10") as stack,
        sync_playwright() as playwright,
    ):
        with Page(stack.url) as hands:
            hands.arm()
            for section, stick, bend in ((0, [0.9, -0.3], 0.45), (1, [-0.7, 0.6], 0.6), (2, [-1, -0.2], 0.9)):
                hands.ask("section", section)
                hands.hold()
                hands.until_phase("driving")
                hands.hold(left=stick)
                stack.observer.wait(
                    "the bend",
                    lambda state, i=section, bend=bend: (
                        state.commanded[2 + 2 * i] ** 2 + state.commanded[3 + 2 * i] ** 2 > bend**2
                    ),
                )
                hands.release()
                hands.until_phase("ready")
        browser = playwright.chromium.launch(executable_path=CHROMIUM, headless=True, args=ARGUMENTS)
        tab = browser.new_context(viewport=SIZE, color_scheme="dark").new_page()
        tab.goto(stack.url)
        viewer = tab.frame_locator("#viewer")
        viewer.locator('canvas[data-engine^="three.js"]').wait_for(timeout=60_000)
        notice = viewer.locator(".mantine-Notification-root button").first
        notice.wait_for(timeout=60_000)
        notice.click(force=True)
        tab.wait_for_timeout(25_000)  # software rendering: let some frames be drawn
        tab.screenshot(path=picture)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/operator-page.png"))
