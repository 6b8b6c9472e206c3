"""Pictures agree with the trace."""

import itertools

import gymnasium as gym
import numpy as np
import pytest
from episodes import ID, ROBOT, encode, task_of
from rendered import HARD_AND_HEAVY, SHAPE, drawn, history_of, is_colour, play
from steered import ARM, OWN
from steered import ID as TELEOP

import impact_gym as ig
from impact_gym.envs.batch import Batch
from impact_gym.render import LAMP, Renderer, chain
from impact_gym.render.palette import ALARM, FAINT, FLANGE, FORCE, INK, OBJECT, TOOL
from impact_gym.task import Task

pytest.importorskip("pygame")
pytestmark = pytest.mark.usefixtures("no_display")


@pytest.mark.parametrize("options", [
    {}, {"coupling": ig.Bistable()}, {"coupling": ig.Rigid()}, {"robot": ROBOT},
    {"coupling": ig.Rigid(), "robot": ROBOT},
], ids=str)  # fmt: skip
def test_tool_flange_and_object_are_drawn_at_their_positions(options):
    env = gym.make(ID, record_trace=True, **options)
    play(env, seed=4, scenario=HARD_AND_HEAVY)
    history, task = history_of(env), task_of(env)
    first, view = history.touches[0], chain.camera(history)  # the camera is fixed
    deflection = history.columns["tool_position"] - history.columns["flange_position"]
    shortest = float(history.time[np.argmin(deflection)])
    for time in (0.5 * first, 0.99 * first, first, shortest, history.events.alarm + 0.02, history.now):
        state, picture = history.at(time), drawn(env, time)
        row = round(view.axis + 0.4 * chain.TOOL_HEIGHT * view.scale)  # nothing else is drawn in this row
        tool = np.flatnonzero(is_colour(picture[row], TOOL))
        mark = 1.0 if is_colour(picture[row], FORCE).any() else 0.0  # the mark of the force covers one pixel
        assert tool[-1] + 1 + mark == pytest.approx(view.x(state.tool_position), abs=1.0)
        assert tool[0] == pytest.approx(view.x(state.tool_position - chain.TOOL_LENGTH), abs=1.0)
        row = round(view.axis + 0.45 * chain.FLANGE_HEIGHT * view.scale)
        flange = np.flatnonzero(is_colour(picture[row], FLANGE))
        behind = chain.TOOL_LENGTH + chain.rest_length(task) + chain.FLANGE_LENGTH
        assert flange[0] == pytest.approx(view.x(state.flange_position - behind), abs=1.0)
        row = round(view.axis)
        ball = np.flatnonzero(is_colour(picture[row], OBJECT))
        radius = chain.object_radius(HARD_AND_HEAVY["object_mass"])
        assert ball[-1] + 1 == pytest.approx(view.x(state.object_position + 2.0 * radius), abs=1.5)
        gap = np.flatnonzero(is_colour(picture[round(2.0 * view.axis - view.ground) - 14], INK))
        ends = sorted([state.tool_position if time < first else HARD_AND_HEAVY["distance"], state.object_position])
        assert gap[[0, -1]] == pytest.approx([view.x(end) for end in ends], abs=2.0)
    if not options:
        assert deflection.min() < -0.03


@pytest.mark.parametrize(("name", "action", "options"), [
    (ID, encode(0.8, 10.0), {"reaction_delay": 0.03}),
    (ID, encode(0.8, 10.0), {"alarm": "reading", "force_noise": 0.6, "after_alarm": 0.05}),  # with false alarms
    (TELEOP, OWN, ARM | {"operator": {"type": "Trapezoid"}, "after_alarm": 0.02}),
], ids=["switch", "reading", "operator"])  # fmt: skip
def test_lamp_is_red_while_the_controller_has_an_alarm_and_settling_begins_at_the_end(name, action, options):
    env, (x, y) = gym.make(name, render_mode="rgb_array", scenario=HARD_AND_HEAVY, **options), map(round, LAMP)
    env.reset(seed=1)
    alarms, ended = [], False
    while not ended:
        _, _, ended, _, _ = env.step(np.array(action, np.float32))
        sensors = env.unwrapped.sensors()
        events = env.unwrapped.episode_state()
        assert events.end == (sensors["time"] if ended else np.inf)
        if not ended:  # later pictures are of the settling
            assert is_colour(env.render()[y, x], ALARM) == sensors["alarm"]
            alarms.append(sensors["alarm"])
    assert set(alarms) == {0.0, 1.0}
    assert (np.diff(alarms).min() < 0.0) == ("alarm" in options)  # only an alarm by readings is cleared
    assert history_of(env).now > events.end + 2e-3
    settling = [is_colour(drawn(env, events.end + side)[510:530, -90:], FAINT).any() for side in (-1e-3, 1e-3)]
    assert settling == [False, True]


@pytest.mark.parametrize(("scenario", "options"), [
    ({"object_mass": 1.0, "contact_stiffness": 1e6, "restitution": 1e-2, "distance": 1e-6}, {}),
    ({"object_mass": 1e6, "contact_stiffness": 1e8, "restitution": 0.7, "distance": 0.2}, {}),
    ({"object_mass": 1.0, "contact_stiffness": 1e-6, "restitution": 1.0, "distance": 0.1}, {}),
    ({"object_mass": 1.0, "contact_stiffness": 1e5, "restitution": 0.5, "distance": 1.7}, {}),  # a miss
    (HARD_AND_HEAVY, {"coupling": ig.SpringDamper(1e-3), "tool_mass": 1e3}),
    (HARD_AND_HEAVY, {"coupling": ig.SpringDamper(1e6, 0.0)}),
])  # fmt: skip
def test_scenes_of_any_scale_are_drawn(scenario, options):
    env = gym.make(ID, record_trace=True, **options)
    play(env, scenario=scenario)
    history = history_of(env)
    assert 10 < sum(1 for _ in itertools.islice(history.film(0.0), 5000)) < 5000
    for time in np.linspace(0.0, history.now, 5):
        assert is_colour(drawn(env, time), INK).any()


def test_episode_too_long_for_its_trace_is_drawn_to_the_end_of_the_trace():
    task = Task(scenario=HARD_AND_HEAVY, horizon=40.0, control_period=0.15)
    batch, renderer, pictures = Batch(1, task, trace_points=400), Renderer("rgb_array"), []
    batch.begin_seeded(1, {})
    for velocity in (-1.0, 1.0, 1.0, 1.0, 1.0):
        batch.step(np.array([[velocity, 1.0]]), batch.ended)
        pictures.append(renderer.render(batch.history(0)))
    assert batch.chains["traced"][0] > 400
    assert (pictures[1] != pictures[0]).any()
    assert pictures[-1].shape == SHAPE
