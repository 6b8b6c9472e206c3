"""Pictures agree with the trace; films are in slow motion around contacts, in every mode; drawing changes no result."""

import copy
import pickle
import sys
from itertools import islice, repeat
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import (
    ARM,
    ID,
    OWN,
    ROBOT,
    TELEOP,
    Given,
    action_table,
    assert_identical,
    begin,
    encode,
    steps,
    task_of,
)
from gymnasium.utils.env_checker import check_env
from random_tasks import EVERYTHING_DRAWN

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs import IDS
from impact_gym.envs.batch import Batch
from impact_gym.render import HOLD, LAMP, Renderer, canvas, chain
from impact_gym.render.film import FRAME_RATE, FRAMES_PER_IMPACT, LONGEST, SHORTEST, History, SlowMotionVideo
from impact_gym.render.palette import ALARM, FAINT, FLANGE, FORCE, INK, OBJECT, TOOL
from impact_gym.sb3 import ImpactVecEnv
from impact_gym.task import Task

pytest.importorskip("pygame")
HARD_AND_HEAVY = {"object_mass": 1.3, "contact_stiffness": 2e5, "restitution": 0.5, "distance": 0.2}
SHORT = {"scenario": HARD_AND_HEAVY | {"distance": 0.02}, "after_alarm": 0.03}


def play(env, seed=1, scenario=None, stop=None, look=None):
    """Play the paper's rule; return the results of `look` after the reset and each step, and those of each step.

    The argument of `look` is whether the episode has ended; by default `look` calls `render`.
    """
    look = look or (lambda ended: env.render() if env.render_mode else None)
    seen, results = [], []
    for result in islice(steps(env, PaperTrapezoid(), seed, scenario=scenario or {}), stop):
        results.append(result)
        seen.append(look(len(result) == 5 and result[2]))
    return seen, results[1:]


def history_of(env, ended=True):
    own = env.unwrapped
    return History(own.trace(), own.episode_info(), task_of(env), own.episode_state(), ended)


def drawn(env, time):
    """The picture of any instant of the episode that `env` has played."""
    return Renderer("rgb_array").draw(history_of(env), time, 8.0).pixels()


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
    behind = chain.TOOL_LENGTH + chain.rest_length(task_of(env)) + chain.FLANGE_LENGTH
    diameter = 2.0 * chain.object_radius(HARD_AND_HEAVY["object_mass"])
    for time in (0.5 * first, 0.99 * first, first, shortest, history.events.alarm + 0.02, history.now):
        state, picture = history.at(time), drawn(env, time)
        rows = [picture[round(view.axis + height * view.scale)]  # nothing else is drawn in these rows
                for height in (0.4 * chain.TOOL_HEIGHT, 0.45 * chain.FLANGE_HEIGHT, 0.0)]  # fmt: skip
        colours = TOOL, FLANGE, OBJECT
        tool, flange, ball = (np.flatnonzero(is_colour(row, name)) for row, name in zip(rows, colours, strict=True))
        mark = is_colour(rows[0], FORCE).any()  # the mark of the force covers one pixel
        assert tool[-1] + 1 + mark == pytest.approx(view.x(state.tool_position), abs=1.0)
        assert tool[0] == pytest.approx(view.x(state.tool_position - chain.TOOL_LENGTH), abs=1.0)
        assert flange[0] == pytest.approx(view.x(state.flange_position - behind), abs=1.0)
        assert ball[-1] + 1 == pytest.approx(view.x(state.object_position + diameter), abs=1.5)


@pytest.mark.parametrize(("name", "action", "options"), [
    (ID, encode(0.8, 10.0), {"reaction_delay": 0.03}),
    (ID, encode(0.8, 10.0), {"alarm": "reading", "force_noise": 0.6, "after_alarm": 0.05}),  # with false alarms
    (TELEOP, OWN, ARM | {"operator": {"type": "Trapezoid"}, "after_alarm": 0.02}),
], ids=["switch", "reading", "operator"])  # fmt: skip
def test_lamp_is_red_during_an_alarm_and_settling_follows(name, action, options):
    near = HARD_AND_HEAVY | {"distance": 0.1}
    env, (x, y) = gym.make(name, render_mode="rgb_array", scenario=near, **options), map(round, LAMP)
    alarms = []
    for _ in steps(env, Given(repeat(np.array(action, np.float32))), seed=1):
        sensors, events = env.unwrapped.sensors(), env.unwrapped.episode_state()
        if events.end == np.inf:  # later pictures are of the settling
            assert is_colour(env.render()[y, x], ALARM) == sensors["alarm"]
            alarms.append(sensors["alarm"])
    assert set(alarms) == {0.0, 1.0}
    assert (np.diff(alarms).min() < 0.0) == ("alarm" in options)  # only an alarm by readings is cleared
    assert history_of(env).now > events.end + 2e-3
    settling = [is_colour(drawn(env, events.end + side)[510:530, -90:], FAINT).any() for side in (-1e-3, 1e-3)]
    assert settling == [False, True]


@pytest.mark.parametrize("options", [
    {"scenario": {"object_mass": 1.0, "contact_stiffness": 1e6, "restitution": 1e-2, "distance": 1e-6}},
    {"scenario": {"object_mass": 1e6, "contact_stiffness": 1e8, "restitution": 0.7, "distance": 0.2}},
    {"scenario": {"object_mass": 1.0, "contact_stiffness": 1e-6, "restitution": 1.0, "distance": 0.1}},
    {"scenario": HARD_AND_HEAVY | {"distance": 1.2}},  # a miss
    {"scenario": HARD_AND_HEAVY, "coupling": ig.SpringDamper(1e-3), "tool_mass": 1e3},
    {"scenario": HARD_AND_HEAVY, "coupling": ig.SpringDamper(1e6, 0.0)},
])  # fmt: skip
def test_scenes_of_any_scale_are_drawn(options):
    env = gym.make(ID, record_trace=True, **options)
    play(env)
    history = history_of(env)
    assert 10 < sum(1 for _ in islice(history.film(0.0), 5000)) < 5000
    assert all(is_colour(drawn(env, time), INK).any() for time in np.linspace(0.0, history.now, 5))


def test_episode_too_long_for_its_trace_is_drawn_to_its_end():
    task = Task(scenario=HARD_AND_HEAVY, horizon=40.0, control_period=0.15)
    batch, renderer, pictures = Batch(1, task, trace_points=400), Renderer("rgb_array"), []
    batch.begin_seeded(1, {})
    for velocity in (-1.0, 1.0, 1.0, 1.0, 1.0):
        batch.step(np.array([[velocity, 1.0]]), batch.ended)
        pictures.append(renderer.render(batch.history(0)))
    assert batch.chains["traced"][0] > 400
    assert (pictures[1] != pictures[0]).any()
    assert pictures[-1].shape == (canvas.HEIGHT, canvas.WIDTH, 3)


@pytest.mark.parametrize("name", IDS)
def test_every_mode_of_every_id_passes_gymnasiums_check(name):
    env = gym.make(name, render_mode="rgb_array")
    task = task_of(env)
    assert env.metadata["render_fps"] == pytest.approx(task.horizon / task.control_period / 18.0, abs=0.5)
    assert gym.make(name, render_mode="rgb_array_list").metadata["render_fps"] == FRAME_RATE
    assert set(env.metadata["render_modes"]) == {"human", "rgb_array", "rgb_array_list"}
    check_env(env.unwrapped)  # also makes one of every mode and renders it
    env.close()


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

    env = gym.make(ID, record_trace=True, **SHORT)
    renderer = Renderer("rgb_array")
    shown, expected = play(env, look=lambda ended: [*renderer.instants(history_of(env, ended))])
    contact, instants = history_of(env), np.concatenate(shown)
    assert min(map(len, shown)) > 0
    assert (np.diff(instants[:, 0]) > 0.0).all()
    assert (instants[0, 0], instants[-1, 0]) == (0.0, contact.now)
    assert contact.now > contact.events.end
    last = renderer.draw(contact, *instants[-1]).pixels()
    env = gym.make(ID, render_mode=mode, **SHORT)
    pictures, results = play(env)
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
    env.close()
    assert not pygame.display.get_init()
    env.reset(seed=2)  # opens another window
    assert pygame.display.get_init() == (mode == "human")
    if mode == "rgb_array_list":
        for _ in range(8):  # not rendered: the next episode begins a new film
            env.step(encode(0.1, 1.0))
        assert_identical(play(env, stop=4)[0], pictures[:4])
    env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_batch_draws_the_pictures_of_gymnasiums_loop(mode):
    """Also after its state was copied or pickled."""
    options = EVERYTHING_DRAWN["spring"] | {"horizon": 0.15, "control_period": 0.05, "scenario": {"distance": 0.01}}
    options |= {"after_alarm": 0.05, "render_mode": "rgb_array"}
    envs, elsewhere = (gym.make_vec(ID, 2, autoreset_mode=mode, **options) for _ in range(2))
    loop = gym.make_vec(ID, 2, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    silent = gym.make_vec(ID, 2, autoreset_mode=mode, **options | {"render_mode": None})
    stable = ImpactVecEnv(2, **options)
    for each in (envs, elsewhere, loop, silent, stable):
        begin(each, seed=4)
    assert_identical(envs.render(), loop.render())
    assert_identical(tuple(stable.get_images()), loop.render())
    ended = 0
    for row in action_table(3, ticks=7, slots=2, lean=(0.4, 0.6)):
        results = envs.step(row)
        assert_identical(results, loop.step(row))
        assert_identical(results, silent.step(row))
        assert_identical(envs.render(), loop.render())
        elsewhere.set_state(pickle.loads(pickle.dumps(envs)).get_state())
        assert_identical(elsewhere.render(), copy.deepcopy(envs).render())
        ended += results[2].sum()
    assert ended > 1


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_rendering_names_what_is_missing(make, monkeypatch):
    env, without = make(ID, render_mode="rgb_array"), make(ID)
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        env.unwrapped.render()
    env.reset(seed=1), without.reset(seed=1)
    with pytest.warns(UserWarning, match="render_mode"):
        assert without.render() is None
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"impact-gym\[render\]"):
        env.render()
    monkeypatch.undo()
    monkeypatch.setenv("SDL_VIDEODRIVER", "nosuch")
    with pytest.raises(RuntimeError, match=r"rgb_array.*SDL_VIDEODRIVER"):
        gym.make(ID, render_mode="human").reset(seed=1)


class Grey(gym.Wrapper):
    """Each step has `count` small pictures, each a little brighter than the last one."""

    def __init__(self, env, count):
        super().__init__(env)
        self.count, self.next = count, 0

    def render(self):
        self.next += self.count
        return [np.full((64, 64, 3), number // 4, np.uint8) for number in range(self.next - self.count, self.next)]


@pytest.mark.parametrize("count", [2, 12])
def test_film_shows_an_episodes_pictures_for_6_to_10_seconds(count, tmp_path):
    clips, ffmpeg = pytest.importorskip("moviepy"), pytest.importorskip("imageio_ffmpeg")
    env = Grey(gym.make(ID, render_mode="rgb_array_list"), count)
    env = SlowMotionVideo(env, str(tmp_path / "films"), lambda _: True)
    play(env, seed=2, scenario=HARD_AND_HEAVY, look=lambda ended: None)
    recorded = list(env.recorded_frames)
    env.close()
    assert (len(recorded) > LONGEST * FRAME_RATE) == (count == 12)
    last = len(recorded) - 1
    if count == 12:  # some are left out, evenly
        expected = np.linspace(0, last, round(LONGEST * FRAME_RATE)).round().astype(int) // 4
    else:  # the last one is repeated
        expected = np.minimum(np.arange(round(SHORTEST * FRAME_RATE)), last) // 4
    (file,) = (tmp_path / "films").glob("*.mp4")
    assert len(expected) - ffmpeg.count_frames_and_secs(file)[0] in (0, 1)  # moviepy's rounding may lose the last
    with clips.VideoFileClip(str(file)) as clip:
        assert clip.fps == FRAME_RATE
        shown = [clip.get_frame((place + 0.5) / FRAME_RATE).mean() for place in range(0, len(expected) - 2, 20)]
    assert shown == pytest.approx(expected[:-2:20], abs=3.0)  # the codec loses a little
