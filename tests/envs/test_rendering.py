"""Pictures agree with the trace; films are in slow motion around contacts, in every mode; drawing changes no result."""

import copy
import itertools
import pickle
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID, ROBOT, action_table, assert_identical, begin, steps
from gymnasium.utils.env_checker import check_env
from random_tasks import EVERYTHING_DRAWN

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs import IDS
from impact_gym.render import HOLD, Renderer, chain
from impact_gym.render.film import FRAME_RATE, FRAMES_PER_IMPACT, History, SlowMotionVideo
from impact_gym.render.palette import FLANGE, FORCE, OBJECT, TOOL
from impact_gym.sb3 import ImpactVecEnv

pytest.importorskip("pygame")
HARD_AND_HEAVY = {"object_mass": 1.3, "contact_stiffness": 2e5, "restitution": 0.5, "distance": 0.2}
SHORT = {"scenario": HARD_AND_HEAVY | {"distance": 0.02}, "after_alarm": 0.03}


def play(env, seed=1, scenario=None, look=lambda ended: None):
    """Play the paper's rule; return `look(ended)` after the reset and each step, and the results of each step."""
    seen, results = [], []
    for result in steps(env, PaperTrapezoid(), seed, scenario=scenario or {}):
        results.append(result)
        seen.append(look(len(result) == 5 and result[2]))
    return seen, results[1:]


def history_of(env, ended=True):
    own = env.unwrapped
    return History(own.trace(), own.episode_info(), own.task, own.episode_state(), ended)


def is_colour(pixels, name):
    return np.abs(pixels.astype(int) - [*bytes.fromhex(name.removeprefix("#"))]).max(axis=-1) <= 12


@pytest.fixture(autouse=True)
def rates(monkeypatch):
    """There is no display, and nothing waits between pictures; the requested rates."""
    found = []
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setattr("pygame.time.Clock", lambda: SimpleNamespace(tick=found.append))
    return found


@pytest.mark.parametrize("options", [
    {}, {"coupling": ig.Bistable()}, {"coupling": ig.Rigid()}, {"robot": ROBOT},
    {"coupling": ig.Rigid(), "robot": ROBOT},
], ids=str)  # fmt: skip
def test_tool_flange_and_object_are_drawn_at_their_positions(options):
    env = gym.make(ID, record_trace=True, **options)
    play(env, seed=4, scenario=HARD_AND_HEAVY)
    history = history_of(env)
    first, view = history.touches[0], chain.camera(history)  # the camera is fixed
    deflection = history.columns["tool_position"] - history.columns["flange_position"]
    shortest = float(history.time[np.argmin(deflection)])
    behind = chain.TOOL_LENGTH + chain.rest_length(env.unwrapped.task) + chain.FLANGE_LENGTH
    diameter = 2.0 * chain.object_radius(HARD_AND_HEAVY["object_mass"])
    for time in (0.5 * first, 0.99 * first, first, shortest, history.events.alarm + 0.02, history.now):
        state, picture = history.at(time), Renderer("rgb_array").draw(history, time, 8.0).pixels()
        rows = [picture[round(view.axis + height * view.scale)]  # nothing else is drawn in these rows
                for height in (0.4 * chain.TOOL_HEIGHT, 0.45 * chain.FLANGE_HEIGHT, 0.0)]  # fmt: skip
        colours = TOOL, FLANGE, OBJECT
        tool, flange, ball = (np.flatnonzero(is_colour(row, name)) for row, name in zip(rows, colours, strict=True))
        mark = is_colour(rows[0], FORCE).any()  # the mark of the force covers one pixel
        assert tool[-1] + 1 + mark == pytest.approx(view.x(state.tool_position), abs=1.0)
        assert tool[0] == pytest.approx(view.x(state.tool_position - chain.TOOL_LENGTH), abs=1.0)
        assert flange[0] == pytest.approx(view.x(state.flange_position - behind), abs=1.0)
        assert ball[-1] + 1 == pytest.approx(view.x(state.object_position + diameter), abs=1.5)


@pytest.mark.parametrize("name", IDS)
def test_every_mode_of_every_id_passes_gymnasiums_check(name):
    check_env(gym.make(name, render_mode="rgb_array").unwrapped)  # also makes one of every mode and renders it


@pytest.mark.parametrize("name", ["ImpactApproach-v0", "ImpactApproachRigid-v0", "ImpactApproachBistable-v0"])
def test_contact_has_many_pictures_at_intervals_of_the_factor(name):
    env = gym.make(name, record_trace=True)
    for seed in range(4):
        _, results = play(env, seed=seed)
        played = history_of(env)
        times, factors = np.array(list(played.film(0.0))).T
        assert np.diff(times, prepend=0.0)[:-1] == pytest.approx(1.0 / (FRAME_RATE * factors[:-1]), rel=1e-6)
        assert times[-1] == played.now
        assert len(results) < len(times) < 600
        inside = (times > played.touches[0]) & (times < played.partings[0])
        assert inside.sum() >= FRAMES_PER_IMPACT - 2
        assert factors[inside][1:].min() >= 32.0  # the first may have been chosen before the touch
        assert 6.0 < len(times) / FRAME_RATE + HOLD < 13.0  # s


@pytest.mark.parametrize("mode", ["rgb_array_list", "human"])
def test_every_mode_shows_each_instant_and_changes_no_result(mode, rates):
    import pygame

    env, renderer = gym.make(ID, record_trace=True, **SHORT), Renderer("rgb_array")
    shown, expected = play(env, look=lambda ended: [*renderer.instants(history_of(env, ended))])
    contact, instants = history_of(env), np.concatenate(shown)
    assert min(map(len, shown)) > 0
    assert (np.diff(instants[:, 0]) > 0.0).all()
    assert (instants[0, 0], instants[-1, 0]) == (0.0, contact.now)
    last = renderer.draw(contact, *instants[-1]).pixels()
    env = gym.make(ID, render_mode=mode, **SHORT)
    pictures, results = play(env, look=lambda ended: env.render())
    assert_identical(results, expected)
    if mode == "human":
        assert pictures == [None] * len(pictures)
        assert rates == [FRAME_RATE] * len(instants) + [1.0 / HOLD]
        window = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
        np.testing.assert_array_equal(window, last)
    else:
        held = round(HOLD * FRAME_RATE)
        assert [*map(len, pictures)] == [*map(len, shown[:-1]), len(shown[-1]) + held]
        np.testing.assert_array_equal(pictures[-1][-1], last)
        assert env.render() == []
    env.close()
    assert not pygame.display.get_init()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_batch_draws_the_pictures_of_gymnasiums_loop(mode):
    """Also after its state was copied or pickled."""
    options = EVERYTHING_DRAWN["spring"] | {"horizon": 0.15, "control_period": 0.05, "scenario": {"distance": 0.01}}
    options |= {"after_alarm": 0.05, "render_mode": "rgb_array"}
    envs, elsewhere = (gym.make_vec(ID, 2, autoreset_mode=mode, **options) for _ in range(2))
    loop = gym.make_vec(ID, 2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    stable = ImpactVecEnv(2, **options)
    for each in (envs, elsewhere, loop, stable):
        begin(each, seed=4)
    assert_identical(envs.render(), loop.render())
    assert_identical(tuple(stable.get_images()), loop.render())
    ended = 0
    for row in action_table(3, ticks=7, slots=2, lean=(0.4, 0.6)):
        results = envs.step(row)
        assert_identical(results, loop.step(row))
        assert_identical(envs.render(), loop.render())
        elsewhere.set_state(pickle.loads(pickle.dumps(envs)).get_state())
        assert_identical(elsewhere.render(), copy.deepcopy(envs).render())
        ended += results[2].sum()
    assert ended > 1


@pytest.mark.parametrize("count", [2, 12])
def test_film_shows_an_episodes_pictures_for_6_to_10_seconds(count, tmp_path, monkeypatch):
    pytest.importorskip("moviepy")
    env, number, kept = gym.make(ID, render_mode="rgb_array_list"), itertools.count(), []
    env.render = lambda: [next(number) for _ in range(count)]  # numbers instead of pictures
    save = lambda film: (kept.extend(film.recorded_frames), film.recorded_frames.clear())  # noqa: E731
    monkeypatch.setattr(gym.wrappers.RecordVideo, "stop_recording", save)
    film = SlowMotionVideo(env, str(tmp_path / "films"), lambda _: True)
    play(film, seed=2, scenario=HARD_AND_HEAVY)
    film.close()
    last, length = next(number) - 1, FRAME_RATE * (10 if count == 12 else 6)
    if count == 12:  # some are left out, evenly
        assert kept == pytest.approx(np.linspace(0.0, last, length), abs=0.5)
    else:  # the last one is repeated
        assert kept == [*range(last + 1)] + [last] * (length - last - 1)
