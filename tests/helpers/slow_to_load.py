"""A module that takes a second to be imported."""

import time

import numpy as np

time.sleep(1.0)


def at_once():
    """Return at once."""
    return {"value": np.array(1.0)}
