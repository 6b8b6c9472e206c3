import pytest
from own_set_up import own_set_up
from pages import chromium


@pytest.fixture
def mine(tmp_path):
    """The file of a user's set-up."""
    return own_set_up(tmp_path)


@pytest.fixture(scope="module")
def browser():
    """Chromium, once for all tests of a file."""
    with chromium() as program:
        yield program
