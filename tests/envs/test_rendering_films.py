"""Pictures follow each other slowed down where something happens, in every mode; drawing them changes nothing."""

import copy
import pickle
import subprocess
import sys
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from episodes import IDS as APPROACHES
from episodes import action_table, assert_identical, begin, history
from gymnasium.utils.env_checker import check_env
from gymnasium.wrappers import RecordVideo
from gymnasium.wrappers import vector as vector_wrappers
from rendered import HARD_AND_HEAVY, ID, SHAPE, history_of, play
from tasks import EVERYTHING_DRAWN

from agents.baselines import PaperTrapezoid, encode
from impact_gym.envs import IDS, rendering
from impact_gym.envs.render_history import FRAMES_PER_IMPACT
from impact_gym.envs.render_video import SlowMotionVideo

pytest.importorskip("pygame")
pytestmark = pytest.mark.usefixtures("no_display")


@pytest.fixture
def no_waiting(monkeypatch):
    """Pictures follow each other as fast as they are drawn; the rates asked for are kept."""
    asked = []
    monkeypatch.setattr("pygame.time.Clock", lambda: SimpleNamespace(tick=asked.append))
    return asked


@pytest.mark.parametrize("name", IDS)
def test_every_mode_of_every_id_passes_gymnasiums_check(name, no_waiting):
    env = gym.make(name, render_mode="rgb_array")
    assert set(env.metadata["render_modes"]) == {"human", "rgb_array", "rgb_array_list"}
    assert env.metadata["render_fps"] == rendering.FRAME_RATE
    check_env(env.unwrapped)  # also makes one of every mode and renders it
    env.close()


def test_a_contact_fills_many_pictures_and_the_factor_is_what_they_are_apart():
    for name in APPROACHES:
        env = gym.make(name, record_trace=True)
        for seed in range(8):
            _, results = play(env, seed=seed)
            played = history_of(env)
            film = np.array(list(played.film(0.0)))
            times, factors = film.T
            apart = 1.0 / (rendering.FRAME_RATE * factors[:-1])
            assert np.diff(times, prepend=0.0)[:-1] == pytest.approx(apart, rel=1e-6)
            assert times[-1] == played.now
            assert len(results) < len(film) < 600
            inside = (times > played.touches[0]) & (times < played.partings[0])
            assert inside.sum() >= FRAMES_PER_IMPACT - 2
            assert factors[inside][1:].min() >= 32.0  # the first may have been chosen before the touch


@pytest.mark.parametrize("mode", ["rgb_array_list", "human"])
def test_pictures_step_by_step_show_the_instants_of_one_go_and_change_no_result(mode, no_waiting, monkeypatch):
    shown, honest = [], rendering.Renderer._drawn

    def drawn(self, history, time, factor):
        shown.append((time, history.now, history.ended))
        return honest(self, history, time, factor)

    monkeypatch.setattr(rendering.Renderer, "_drawn", drawn)
    env = gym.make(ID, render_mode=mode)
    pictures, results = play(env, scenario=HARD_AND_HEAVY)
    assert_identical(results, play(gym.make(ID), scenario=HARD_AND_HEAVY)[1])
    times = np.array([time for time, _, _ in shown])
    assert times[0] == 0.0
    assert (np.diff(times) > 0.0).all()
    per_step = np.unique([now for _, now, ended in shown if not ended], return_counts=True)
    assert len(per_step[0]) == len(results)  # the reset and every step but the last, which goes on to the settling
    contact = history_of(env)
    assert ((times > contact.touches[0]) & (times < contact.partings[0])).sum() >= FRAMES_PER_IMPACT - 2
    assert times[-1] == contact.now > contact.end_of_control
    if mode == "human":
        assert pictures == [None] * len(pictures)
        assert no_waiting[:-1] == [rendering.FRAME_RATE] * len(shown)
        assert no_waiting[-1] == 1.0 / rendering.HOLD
    else:
        held = round(rendering.HOLD * rendering.FRAME_RATE)
        assert sum(map(len, pictures)) == len(shown) + held
        assert env.render() == []
    env.close()


def test_a_window_shows_the_picture(no_waiting):
    import pygame

    env = gym.make(ID, render_mode="human")
    play(env, stop=3)
    window = pygame.surfarray.array3d(pygame.display.get_surface()).transpose(1, 0, 2)
    reference = gym.make(ID, render_mode="rgb_array_list")
    pictures, _ = play(reference, stop=3)
    np.testing.assert_array_equal(window, pictures[-1][-1])
    env.close()
    env.close()
    assert not pygame.display.get_init()
    env.reset(seed=2)  # opens another
    assert pygame.display.get_init()
    env.close()


def test_a_new_episode_begins_its_own_film():
    env = gym.make(ID, render_mode="rgb_array_list")
    once, _ = play(env, seed=3, stop=5)
    play(env, seed=1, stop=2)
    env.reset(seed=6)
    for _ in range(30):  # not rendered: longer than what was shown of the episode before
        env.step(encode(0.1, 1.0))
    again, _ = play(env, seed=3, stop=5)
    assert_identical(once, again)
    env.close()
    env.close()
    assert len(play(env, seed=3, stop=5)[0][0]) == 1


def test_an_environment_that_has_drawn_is_copied_and_pickled():
    env = gym.make(ID, render_mode="rgb_array_list").unwrapped
    play(env, stop=4)
    copied, unpickled = copy.deepcopy(env), pickle.loads(pickle.dumps(env))
    expected = env.step(encode(1.0, 8.0)), env.render()
    for twin in (copied, unpickled):
        assert_identical((twin.step(encode(1.0, 8.0)), twin.render()), expected)


def test_pygame_is_imported_for_the_first_picture_and_not_before():
    program = """
import sys
from types import SimpleNamespace
import gymnasium as gym, impact_gym
for mode in (None, "rgb_array"):
    env = gym.make("ImpactApproach-v0", render_mode=mode)
    env.reset(seed=1)
    env.step(env.action_space.sample())
    assert "pygame" not in sys.modules
assert "impact_gym.envs.rendering" not in sys.modules
env.render()
assert "pygame" in sys.modules
"""
    subprocess.run([sys.executable, "-c", program], check=True, timeout=120)


def test_without_pygame_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    env = gym.make(ID, render_mode="rgb_array")
    env.reset(seed=1)
    with pytest.raises(gym.error.DependencyNotInstalled, match=r"pip install 'impact-gym\[render\]'"):
        env.render()


def test_a_display_that_is_not_there_is_named(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "nosuch")
    env = gym.make(ID, render_mode="human")
    with pytest.raises(RuntimeError, match=r"rgb_array.*SDL_VIDEODRIVER"):
        env.reset(seed=1)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_batch_draws_what_gymnasiums_loop_draws_and_goes_on_drawing_from_a_state(mode):
    options = {"render_mode": "rgb_array", **EVERYTHING_DRAWN["spring"]}
    envs, elsewhere = (gym.make_vec(ID, num_envs=3, autoreset_mode=mode, **options) for _ in range(2))
    loop = gym.make_vec(ID, 3, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    silent = gym.make_vec(ID, num_envs=3, autoreset_mode=mode, **EVERYTHING_DRAWN["spring"])
    for each in (envs, elsewhere, loop, silent):
        begin(each, seed=4)
    assert_identical(envs.render(), loop.render())
    ended = 0
    for row in action_table(3, ticks=50, slots=3, lean=(0.4, 0.6)):
        results = [each.step(row) for each in (envs, silent, loop)]
        assert_identical(results[0], results[1])
        if results[0][2].any() or ended > 0:
            assert_identical(envs.render(), loop.render())
            elsewhere.set_state(pickle.loads(pickle.dumps(envs)).get_state())
            assert_identical(elsewhere.render(), copy.deepcopy(envs).render())
            ended += results[0][2].sum()
        if ended > 2:
            break
    assert ended > 2


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_calls_of_render_that_can_draw_nothing_are_named(make):
    with pytest.raises(gym.error.ResetNeeded, match="reset"):
        make(ID, render_mode="rgb_array").unwrapped.render()
    env = make(ID)
    env.reset(seed=1)
    with pytest.warns(UserWarning, match="render_mode"):
        assert env.render() is None


@pytest.mark.parametrize(("recorder", "mode", "slow"), [
    (RecordVideo, "rgb_array", False), (RecordVideo, "rgb_array_list", False),
    (SlowMotionVideo, "rgb_array", False), (SlowMotionVideo, "rgb_array_list", True),
])  # fmt: skip
def test_films_play(recorder, mode, slow, tmp_path):
    pytest.importorskip("moviepy")
    from imageio_ffmpeg import count_frames_and_secs
    from moviepy import VideoFileClip

    env = recorder(gym.make(ID, render_mode=mode), str(tmp_path / "films"), episode_trigger=lambda number: number == 0)
    played = history(env, PaperTrapezoid(), seed=2, scenario=HARD_AND_HEAVY)
    assert_identical(played, history(gym.make(ID), PaperTrapezoid(), seed=2, scenario=HARD_AND_HEAVY))
    steps = len(played) - 1
    recorded = list(env.recorded_frames)
    env.close()
    (film,) = (tmp_path / "films").glob("*.mp4")
    assert len(recorded) > 5 * steps if slow else len(recorded) == steps + 1
    assert len(recorded) - count_frames_and_secs(film)[0] in (0, 1)  # moviepy's rounding may lose the last
    with VideoFileClip(str(film)) as clip:
        assert clip.fps == rendering.FRAME_RATE
        for place in (0, len(recorded) // 2, len(recorded) - 3):
            picture = clip.get_frame((place + 0.5) / rendering.FRAME_RATE)
            assert picture.shape == SHAPE
            assert np.abs(picture.astype(int) - recorded[place]).mean() < 5.0  # the codec loses a little


def test_a_film_of_a_batch_has_a_tile_for_each(tmp_path):
    pytest.importorskip("moviepy")
    from moviepy import VideoFileClip

    height, width, _ = SHAPE
    envs = vector_wrappers.RecordVideo(gym.make_vec(ID, num_envs=4, render_mode="rgb_array"), str(tmp_path / "films"))
    envs.reset(seed=3)
    shown, ended = [], [False]
    while not ended[0]:  # a film ends with the episode of the first
        _, _, ended, _, _ = envs.step(np.tile(encode(1.0, 8.0), (4, 1)))
        shown.append(envs.env.render())
    envs.close()
    (film,) = (tmp_path / "films").glob("*-0.mp4")
    with VideoFileClip(str(film)) as clip:
        assert clip.fps == rendering.FRAME_RATE
        place = len(shown) // 2
        picture = clip.get_frame((place + 1.5) / rendering.FRAME_RATE)  # the first is of the reset
    assert picture.shape == (2 * height, 2 * width, 3)
    for tile, pixels in enumerate(shown[place]):
        top, left = tile // 2 * height, tile % 2 * width
        assert np.abs(picture[top : top + height, left : left + width].astype(int) - pixels).mean() < 5.0
