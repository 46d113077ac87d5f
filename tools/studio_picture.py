"""The README's picture of the studio: python tools/studio_picture.py (needs chromium).

The shipped cartpole agent balances; docs/images/studio.png is made anew.
"""

import shutil
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

from everystate.viewing.studio import Studio

PICTURE = Path(__file__).resolve().parents[1] / "docs" / "images" / "studio.png"
SWING_UP = 10.0  # seconds that it takes at most


def main() -> None:
    """Opens the page, presses `balance`, waits and looks."""
    studio = Studio("cartpole", port=0)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={"width": 1200, "height": 1060})
        page.goto(studio.address)
        page.get_by_role("button", name="balance").click(timeout=60_000)
        page.mouse.click(288, 100)  # what it says of a browser without a graphics card
        time.sleep(SWING_UP)
        page.screenshot(path=PICTURE)
        browser.close()
    studio.close()
    print(PICTURE)


if __name__ == "__main__":
    main()
