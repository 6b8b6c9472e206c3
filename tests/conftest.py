import pytest
from browser_pages import chromium
from own_set_up import TEXT


@pytest.fixture
def mine(tmp_path):
    (path := tmp_path / "mine.toml").write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def browser():
    with chromium() as program:
        yield program
