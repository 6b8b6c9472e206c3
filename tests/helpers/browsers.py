"""Debian's Chromium, driven by Playwright."""

import shutil
from contextlib import contextmanager

import pytest


@contextmanager
def chromium():
    """Give a browser; skip where there is none."""
    programs = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no Chromium is installed")
    with programs.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


def opened(browser, file, width=1280, height=900, **options):
    """Return a page that shows a file, and the list of its complaints and of its requests to elsewhere."""
    page = browser.new_context(viewport={"width": width, "height": height}, **options).new_page()
    problems = []
    page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: problems.append(str(error)))
    page.on("request", lambda request: request.url.startswith(("file:", "data:")) or problems.append(request.url))
    page.goto(file.as_uri())
    return page, problems
