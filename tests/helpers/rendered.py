"""Episodes played for their pictures, and functions to read pictures."""

import numpy as np
from episodes import task_of

from agents.baselines import PaperTrapezoid
from impact_gym.render import Renderer, canvas
from impact_gym.render.film import History

SHAPE = (canvas.HEIGHT, canvas.WIDTH, 3)
HARD_AND_HEAVY = {"object_mass": 1.3, "contact_stiffness": 2e5, "restitution": 0.5, "distance": 0.2}


def play(env, seed=1, scenario=None, stop=10**6, look=None):
    """Play the paper's rule; return the results of `look` after the reset and each step, and those of each `step`.

    The argument of `look` is whether the episode has ended; by default `look` calls `render`.
    """
    look = look or (lambda ended: env.render() if env.render_mode else None)
    observation, _ = env.reset(seed=seed, options={"scenario": scenario or {}})
    seen, results = [look(False)], []
    while not (results and results[-1][2]) and len(results) < stop:
        results.append(env.step(PaperTrapezoid().predict(observation)[0]))
        observation = results[-1][0]
        seen.append(look(results[-1][2]))
    return seen, results


def history_of(env, ended=True):
    own = env.unwrapped
    return History(own.trace(), own.episode_info(), task_of(env), own.episode_state(), ended)


def drawn(env, time):
    """The picture of any instant of the episode that `env` has played."""
    return Renderer("rgb_array").draw(history_of(env), time, 8.0).pixels()


def is_colour(pixels, name):
    return np.abs(pixels.astype(int) - [*bytes.fromhex(name.removeprefix("#"))]).max(axis=-1) <= 12
