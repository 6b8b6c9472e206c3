import pytest
from play_client import Simulated, served


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("play") / "tries") as running:
        yield running


@pytest.fixture
def world(tmp_path):
    made = Simulated(tmp_path)
    yield made
    made.session.close()
