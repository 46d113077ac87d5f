"""A studio's page in a browser."""

from typing import Any

from everystate.viewing.studio import Studio


def opened(browser: Any, studio: Studio) -> tuple[Any, list[str]]:
    """A page of the studio, and the addresses it asked for."""
    page, asked = browser.new_page(viewport={"width": 1280, "height": 900}), []
    page.set_default_timeout(120_000)  # by software alone it draws slowly
    page.on("request", lambda request: asked.append(request.url))
    page.goto(studio.address)
    page.get_by_role("button", name="surprise me").wait_for()
    return page, asked
