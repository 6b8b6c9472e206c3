import pytest


@pytest.fixture
def no_display(monkeypatch):
    """Nothing that draws needs a display."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
