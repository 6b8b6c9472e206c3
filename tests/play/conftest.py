import pytest
from play_client import served


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("play") / "tries") as running:
        yield running
