import pytest
from play_client import Simulated


@pytest.fixture
def world(tmp_path):
    made = Simulated(tmp_path)
    yield made
    made.session.close()
