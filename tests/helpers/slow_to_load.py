"""A module that takes a second to be imported."""

import time

time.sleep(1.0)


def at_once():
    return 1.0
