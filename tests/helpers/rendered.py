"""Episodes played for their pictures, and how to read these."""

import numpy as np

from agents.baselines import PaperTrapezoid
from impact_gym.render import Renderer, canvas

SHAPE = (canvas.HEIGHT, canvas.WIDTH, 3)
HARD_AND_HEAVY = {"object_mass": 1.3, "contact_stiffness": 2e5, "restitution": 0.5, "distance": 0.2}


def play(env, seed=1, scenario=None, stop=10**6, look=None):
    """Play the paper's rule; return what `look` returned after the reset and each step, and each `step`'s results.

    By default `look` is `render`.
    """
    look = look or (lambda: env.render() if env.render_mode else None)
    observation, _ = env.reset(seed=seed, options={"scenario": scenario or {}})
    seen, results = [look()], []
    while not (results and results[-1][2]) and len(results) < stop:
        results.append(env.step(PaperTrapezoid().predict(observation)[0]))
        observation = results[-1][0]
        seen.append(look())
    return seen, results


def drawn(history, time):
    """The picture of any instant of an episode."""
    return Renderer("rgb_array").picture(history, time, 8.0)


def is_colour(pixels, name):
    return np.abs(pixels.astype(int) - [*bytes.fromhex(name.removeprefix("#"))]).max(axis=-1) <= 12
