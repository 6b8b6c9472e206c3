"""The pictures show what the trace says."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from episodes import IDS, ROBOT, Always
from rendered import HARD_AND_HEAVY, ID, SHAPE, column, drawn, history_of, is_colour, lamp, play, rendering_task

import impact_gym as ig
from agents.baselines import PaperTrapezoid
from impact_gym.envs import render_canvas, render_chain, render_strips

pytest.importorskip("pygame")
pytestmark = pytest.mark.usefixtures("no_display")


@pytest.mark.parametrize("name", IDS)
def test_pictures_have_the_shape_asked_for_and_change_as_things_move(name):
    env = gym.make(name, render_mode="rgb_array")
    pictures, results = play(env)
    assert all(picture.shape == SHAPE and picture.dtype == np.uint8 for picture in pictures)
    assert all((one != other).any() for one, other in itertools.pairwise(pictures))
    again = env.render()
    np.testing.assert_array_equal(again, pictures[-1])
    assert not np.shares_memory(again, pictures[-1])
    assert len(results) == len(pictures) - 1


@pytest.mark.parametrize("options", [
    {}, {"coupling": ig.Bistable()}, {"coupling": ig.Rigid()}, {"robot": ROBOT},
    {"coupling": ig.Rigid(), "robot": ROBOT},
], ids=str)  # fmt: skip
def test_tool_and_flange_are_drawn_where_the_trace_has_them(options):
    env = gym.make(ID, record_trace=True, **options)
    play(env, seed=4)
    history, task = history_of(env), rendering_task(env)
    first = history.touches[0]
    for time in (0.5 * first, 0.99 * first, first + 0.004, history.alarm + 0.02, history.now):
        state = history.at(time)
        view = render_chain.camera(task, state)
        picture = drawn(env, time)
        row = round(view.axis + 0.4 * render_chain.TOOL_HEIGHT * view.scale)  # where nothing else is drawn
        tool = np.flatnonzero(is_colour(picture[row], render_canvas.TOOL))
        mark = 1.0 if is_colour(picture[row], render_canvas.FORCE).any() else 0.0  # the mark of the force covers this
        assert tool[-1] + 1 + mark == pytest.approx(column(view, state.tool_position), abs=1.0)
        assert tool[0] == pytest.approx(column(view, state.tool_position - render_chain.TOOL_LENGTH), abs=1.0)
        row = round(view.axis + 0.45 * render_chain.FLANGE_HEIGHT * view.scale)
        flange = np.flatnonzero(is_colour(picture[row], render_canvas.FLANGE))
        behind = render_chain.TOOL_LENGTH + render_chain.rest_length(task) + render_chain.FLANGE_LENGTH
        assert flange[0] == pytest.approx(column(view, state.flange_position - behind), abs=1.0)


def test_the_spring_is_as_much_shorter_as_it_is_compressed():
    env = gym.make(ID, record_trace=True)
    play(env, scenario=HARD_AND_HEAVY)
    history, task = history_of(env), rendering_task(env)
    lengths, stretches = [], []
    deflection = history.columns["tool_position"] - history.columns["flange_position"]
    for time in (history.touches[0], float(history.time[np.argmin(deflection)])):
        state = history.at(time)
        view = render_chain.camera(task, state)
        picture = drawn(env, time)[: round(render_chain.PANEL[1] + render_chain.PANEL[3])]
        columns = np.flatnonzero(is_colour(picture, render_canvas.COUPLING).any(axis=0))
        lengths.append((columns[-1] + 1 - columns[0]) / view.scale)
        stretches.append(state.tool_position - state.flange_position)
    assert stretches[1] < stretches[0] - 0.03
    assert lengths[0] - lengths[1] == pytest.approx(stretches[0] - stretches[1], abs=3.0 / view.scale)


def test_the_camera_keeps_tool_and_object_in_view_and_does_not_jump():
    for name in IDS:
        env = gym.make(name, record_trace=True)
        for seed in range(5):
            play(env, seed=seed)
            history, task = history_of(env), rendering_task(env)
            before = None
            for time, _ in history.film(0.0):
                state = history.at(time)
                view = render_chain.camera(task, state)
                for place in (state.tool_position - render_chain.TOOL_LENGTH, state.object_position):
                    assert 0.0 < view.x(place) < render_canvas.WIDTH
                if before is not None:
                    assert abs(view.x(state.tool_position) - before[0]) < 25.0
                    assert abs(np.log(view.scale / before[1])) < 0.05
                before = view.x(state.tool_position), view.scale


def test_the_lamp_is_lit_by_the_force_and_turns_red_when_the_controller_knows():
    env = gym.make(ID, record_trace=True, reaction_delay=0.03)
    observation, _ = env.reset(seed=1, options={"scenario": HARD_AND_HEAVY})
    while observation[3] < 0.5:
        observation, _, ended, _, _ = env.step(PaperTrapezoid().predict(observation)[0])
    told = env.unwrapped.trace().time[-1]  # when the first step ended at which the controller had the alarm
    while not ended:
        observation, _, ended, _, _ = env.step(PaperTrapezoid().predict(observation)[0])
    history = history_of(env)
    assert history.alarm == pytest.approx(told, abs=1e-12)
    force = np.interp(history.detection, history.time, history.columns["contact_force"])
    assert force == pytest.approx(1.0, rel=1e-6)
    for time, name in (
        (history.detection - 1e-4, render_canvas.GRID),
        (history.detection + 1e-4, render_canvas.WARNING),
        (history.alarm - 1e-4, render_canvas.WARNING),
        (history.alarm + 1e-4, render_canvas.ALARM),
        (history.now, render_canvas.ALARM),
    ):
        assert is_colour(lamp(drawn(env, time)), name)
    picture = drawn(env, history.alarm + 0.01)
    left, top, width, height = map(round, render_strips.FORCE)
    strip = picture[top : top + height, left : left + width]
    for name in (render_canvas.WARNING, render_canvas.ALARM, render_canvas.FORCE):
        assert is_colour(strip, name).any()


@pytest.mark.parametrize(("scenario", "options"), [
    ({"object_mass": 1.0, "contact_stiffness": 1e6, "restitution": 1e-2, "distance": 1e-6}, {}),
    ({"object_mass": 1e6, "contact_stiffness": 1e8, "restitution": 0.7, "distance": 0.2}, {}),
    ({"object_mass": 1.0, "contact_stiffness": 1e-6, "restitution": 1.0, "distance": 0.1}, {}),
    ({"object_mass": 1.0, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 1e9}, {}),
    (HARD_AND_HEAVY, {"coupling": ig.SpringDamper(1e-3), "tool_mass": 1e3}),
    (HARD_AND_HEAVY, {"coupling": ig.SpringDamper(1e6, 0.0)}),
])  # fmt: skip
def test_scenes_of_any_scale_are_drawn(scenario, options):
    env = gym.make(ID, render_mode="rgb_array", **options)
    pictures, results = play(env, scenario=scenario)
    assert results[-1][2]
    assert pictures[-1].shape == SHAPE
    history = history_of(env)
    film = itertools.islice(history.film(0.0), 5000)
    assert 10 < sum(1 for _ in film) < 5000
    for time in np.linspace(0.0, history.now, 9):
        assert is_colour(drawn(env, time), render_canvas.INK).any()


def test_an_episode_too_long_for_its_trace_is_drawn_as_far_as_that_goes(monkeypatch):
    monkeypatch.setattr(ig.envs.single, "TRACE_POINTS", 400)
    env = gym.make(ID, render_mode="rgb_array")
    pictures, results = play(env, scenario=HARD_AND_HEAVY)
    with pytest.raises(RuntimeError, match="400"):
        env.unwrapped.trace()
    assert results[-1][2]
    assert (pictures[5] != pictures[4]).any()
    assert pictures[-1].shape == SHAPE


def test_a_miss_and_a_truncated_episode_are_drawn_too():
    still = Always(0.0, 20.0)
    env = gym.make(ID, render_mode="rgb_array_list", max_episode_steps=20)
    pictures, _ = play(env, policy=still, stop=20)
    assert is_colour(lamp(pictures[-1][-1]), render_canvas.GRID)
    env = gym.make(ID, render_mode="rgb_array")
    pictures, results = play(env, policy=still)
    assert results[-1][4]["missed"]
    assert (pictures[-1] != pictures[-2]).any()
