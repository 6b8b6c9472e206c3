"""Episodes played for their pictures, and how to read these."""

import numpy as np

from agents.baselines import PaperTrapezoid
from impact_gym.envs import render_canvas, rendering
from impact_gym.envs.render_history import History

ID = "ImpactApproach-v0"
SHAPE = (render_canvas.HEIGHT, render_canvas.WIDTH, 3)
HARD_AND_HEAVY = {"object_mass": 1.3, "contact_stiffness": 2e5, "restitution": 0.5, "distance": 0.2}


def play(env, seed=1, policy=None, scenario=None, stop=10**6):
    """Play an episode; return what `render` gave after the reset and each step, and what each `step` gave."""
    policy = policy or PaperTrapezoid()
    observation, _ = env.reset(seed=seed, options={"scenario": scenario or {}})
    pictures, results = [env.render() if env.render_mode else None], []
    while not (results and results[-1][2]) and len(results) < stop:
        action, _ = policy.predict(observation)
        results.append(env.step(action))
        observation = results[-1][0]
        pictures.append(env.render() if env.render_mode else None)
    return pictures, results


def history_of(env):
    return History(env.unwrapped.trace(), env.unwrapped.episode_info(), rendering_task(env), ended=True)


def rendering_task(env):
    return env.unwrapped._batch.tasks[0]


def drawn(env, time):
    """The picture of any instant of the episode that `env` has played, through the renderer's own path."""
    renderer = rendering.Renderer(rendering_task(env), "rgb_array")
    return renderer._pixels(history_of(env), time, 8.0)


def is_colour(pixels, name):
    return np.abs(pixels.astype(int) - [*bytes.fromhex(name.removeprefix("#"))]).max(axis=-1) <= 12


def column(view, position):
    """Where a position (m) must be drawn to scale."""
    return (position - view.left) * view.scale


def lamp(picture):
    x, y = rendering.LAMP
    return picture[round(y), round(x)]
