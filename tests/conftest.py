import shutil

import pytest
from own_set_up import TEXT


@pytest.fixture
def mine(tmp_path):
    (path := tmp_path / "mine.toml").write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def browser():
    """Chromium; without it the test is skipped."""
    programs = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no Chromium is installed")
    options = {"executable_path": program, "args": ["--no-sandbox"]}
    with programs.sync_playwright() as playwright, playwright.chromium.launch(**options) as opened:
        yield opened
