"""Checks that hold for every page of an experiment, and Chromium, driven by Playwright, to open pages."""

import re
import shutil
from contextlib import contextmanager

import pytest


def text_of_a_page_that_stands_on_its_own(folder, figures):
    """Check that it embeds its figures and links only to files that exist; return it with V_p and m^1.5."""
    text = (folder / "index.html").read_text()
    assert len(re.findall("data:image/svg", text)) == figures
    assert not re.search(r"""(src|href)=["'](https?:|//)""", text)
    for file in re.findall('href="([^"#]+)"', text):
        assert (folder / file).is_file()
    return re.sub(r"<sup>([^<]+)</sup>", r"^\1", re.sub(r"<sub>(\w+)</sub>", r"_\1", text))


@contextmanager
def chromium():
    """Yield a browser; skip the test if there is none."""
    programs = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no Chromium is installed")
    with programs.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield browser
        browser.close()


def opened(browser, file, width=1280, height=900, own=("file:", "data:"), **options):
    """Return a page at a file or an address, and its messages, errors, and requests to others than `own` (starts)."""
    page, problems = browser.new_context(viewport={"width": width, "height": height}, **options).new_page(), []
    page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: problems.append(str(error)))
    for kind in ("request", "websocket"):
        page.on(kind, lambda asked: asked.url.startswith(own) or problems.append(asked.url))
    page.goto(file if isinstance(file, str) else file.as_uri())
    return page, problems


def stands_on_its_own(browser, file, width=1280):
    """Check what holds for every page; return it in a window of this width, with all folds open.

    Nothing comes from other servers, no script fails, links have targets, pictures and controls names; all fits.
    """
    page, problems = opened(browser, file, width)
    page.evaluate("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    page.wait_for_load_state("networkidle")
    for link in page.evaluate("[...document.querySelectorAll('a[href]')].map(link => link.getAttribute('href'))"):
        name, _, key = link.partition("#")
        assert (file.parent / name).exists(), link
        assert name or page.evaluate("key => document.getElementById(key) !== null", key), link
    parts = "a[href], button, select, input, summary, img, slow-motion, [role=img]:not(svg *), [role=region]"
    named = "part => (part.ariaLabel || part.alt || part.labels?.[0]?.textContent || part.textContent).trim()"
    assert page.evaluate(f"[...document.querySelectorAll('{parts}')].filter(part => !({named})(part)).length") == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert problems == []
    return page
