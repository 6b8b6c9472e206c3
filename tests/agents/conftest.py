import pytest
from tiny_training import ALL_PARTS, tiny

from agents.train.ppo import train


@pytest.fixture(scope="session")
def all_parts(tmp_path_factory):
    """A short training that draws numbers, has nominal environments, and imitates for its first half."""
    path = tmp_path_factory.mktemp("setup") / "all-parts.toml"
    path.write_text(ALL_PARTS)
    return tiny(path, nominal=0.5, teacher="blind-profile", imitation_steps=2048)


@pytest.fixture(scope="session")
def finished(all_parts, tmp_path_factory):
    """The folder of this training after its end; tests only read it."""
    return train(all_parts, tmp_path_factory.mktemp("trained") / "run")
