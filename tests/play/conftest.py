import pytest
from faked_page import Faked
from play_client import Simulated


@pytest.fixture
def world(tmp_path):
    made = Simulated(tmp_path)
    yield made
    made.session.close()


@pytest.fixture
def faked(browser, world, request):
    """The page; a test can give other options."""
    made = Faked(browser, world, **getattr(request, "param", {"has_touch": True}))
    yield made
    made.page.context.close()
    assert made.problems == []
