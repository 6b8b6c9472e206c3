import pytest
from own_set_up import own_set_up


@pytest.fixture
def mine(tmp_path):
    """A set-up of one's own, in a file."""
    return own_set_up(tmp_path)
