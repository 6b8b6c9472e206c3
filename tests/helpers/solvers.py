"""The fast solver and the slow one, for tests of what both must come to."""

from functools import partial

import pytest

import impact_gym as ig
from experiments import reference

fast, slow = partial(ig.simulate, rtol=1e-12), partial(reference.simulate, rtol=1e-11)
BOTH = pytest.mark.parametrize("simulate", [fast, slow], ids=["fast", "slow"])
