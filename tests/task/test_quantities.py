"""The table of quantities: limits, draws, paths and observations of each of its rows."""

import dataclasses
import math
from fractions import Fraction
from functools import partial

import gymnasium as gym
import numpy as np
import pytest
from episode_runs import ID
from random_tasks import EVERYTHING_DRAWN, STEERED_DRAWN
from reference_task import scaled
from refusal import Allowed, check_number, refused
from scipy.stats import kstest
from solver_scenes import split, with_every_number

import impact_gym as ig
from impact_gym import quantities as table
from impact_gym.quantities import EPISODE, QUANTITIES, SCENARIO, SET_UP
from impact_gym.support import dotted_paths
from impact_gym.support.validation import unit_text
from impact_gym.task import ObservationSpec, ScenarioRanges, Task
from impact_gym.task.episodes import reset_options
from impact_gym.task.task import ARGUMENTS

EVERY_ROW = pytest.mark.parametrize("row", QUANTITIES.values(), ids=list(QUANTITIES))
COUPLINGS = ig.SpringDamper(150.0, stroke=0.02), ig.Bistable()
RECORDS = [with_every_number(coupling, dissipation="fixed") for coupling in COUPLINGS]
NUMBERS = {path: records for records in RECORDS for path in dotted_paths.flatten(records)}
"""The records by each dotted path of a number in them."""

ALL_DRAWN = EVERYTHING_DRAWN | STEERED_DRAWN
EPISODES = 3000
GIVEN = ARGUMENTS.keys() - {row.id for row in table.SENSORS}  # the argument "alarm" is not the sensor


def inputs(row):
    """The places that accept a number of a row: its name in messages, a function of it, one of a pair or None."""
    yield f"{row.id}[0]", lambda value: row.interval((value, value)), row.interval
    path = row.path or row.id
    if path in NUMBERS:
        records, (parent, _, field) = NUMBERS[path], path.rpartition(".")
        kind = type(dotted_paths.get(records, parent)).__name__
        yield f"{kind}.{field}", lambda value: dotted_paths.replaced(records, {path: value}), None
    if row in SCENARIO:
        take = lambda value: ScenarioRanges(**{row.id: value})  # noqa: E731
        yield f"ScenarioRanges.{row.id}", take, take
    if row in (*SCENARIO, *EPISODE):
        fixed = partial(reset_options, tasks=[Task(reaction_delay=1.0)])
        yield f"options['record']['{row.id}']", lambda value: fixed({"record": {row.id: value}}), None
    if row.id in GIVEN and not row.id.endswith("_range"):
        yield row.id, lambda value: Task(**{row.id: value}), None
    if row.id.startswith(("coupling.", "robot.")) and path in NUMBERS:
        part, _, field = row.id.partition(".")
        kind = type(dotted_paths.get(NUMBERS[path], part)).__name__
        given = dataclasses.asdict(dotted_paths.get(NUMBERS[path], part)) | {"type": kind}
        take = lambda value: Task(**{part: given | {field: value}})  # noqa: E731
        yield f"{row.id}[1]", lambda value: take((given[field], value)), take
    if row.id in ("duration", "rtol"):
        yield row.id, lambda value: ig.simulate(*split(RECORDS[0]), **{row.id: value}), None


@EVERY_ROW
def test_number_is_taken_up_to_its_limits_and_not_beyond(row):
    allowed = Allowed(row.unit, *row.limits)
    low, high = [value for value in (1e-3, 2e-3, 0.5, 1.0, 1.5) if value in allowed][:2]
    check_number(row.check, row.id, allowed)
    for end in allowed.ends:
        assert (row.check(end), row.interval([end, end])) == (end, (end, end))
    for kind in (int, np.uint8, np.int64, np.float32, Fraction) * (1 in allowed):
        assert type(row.check(kind(1))) is float
    for name, take, take_pair in inputs(row):
        check_number(take, name, allowed, wrong=("1", np.True_))
        if take_pair:
            says = "inverted", f"low {high:g}", f"high {low:g} {row.unit}"[:-1]
            refused(partial(take_pair, (high, low)), row.id, *says)
            refused(partial(take_pair, (low, high, high)), row.id, "pair", unit_text(row.unit))


@EVERY_ROW
def test_limits_are_those_of_the_unit_and_enclose_the_draws(row):
    low, high = max(row.limits[:2]), row.limits.at_most
    size = row.unit in ("N s/m", "1/s", "Hz") or row.words.startswith(("standard deviation", "delay"))
    share = row.id == "restitution" or row.words.startswith(("share", "fraction"))
    positive = row.unit in ("kg", "N/m", "N/m^1.5", "1/s^2", "rad/s") or row.id in ("distance", "restitution")
    assert low > 0.0 or not positive
    if row not in (*table.COMMANDS, *table.STEERED):
        assert low >= 0.0 or not size | share
        assert high <= 1.0 or not share
    if row in SET_UP or row in SCENARIO:
        assert row.draw.by_ratio == (row.scale.curve == "log")
        assert max(low, row.scale.low) < min(row.scale.high, high)


@pytest.mark.parametrize("path", NUMBERS)
def test_path_is_read_and_changed(path):
    records, before = NUMBERS[path], dotted_paths.flatten(NUMBERS[path])
    value = Fraction(0.98 * before[path] or 0.01)  # a record stores any number as a float
    changed = dotted_paths.replaced(records, {path: value})
    assert dotted_paths.flatten(changed) == before | {path: float(value)}
    assert dotted_paths.get(records, path) == before[path]


def shares(task, record):
    """Each drawn number, mapped by its range or its normal law to a uniform one in [0, 1)."""
    uniform = {}
    for name, (low, high) in task.ranges.items():
        bend = np.log if QUANTITIES[name].draw.by_ratio and low > 0.0 else np.asarray
        uniform[name] = (bend(record[name]) - bend(low)) / (bend(high) - bend(low))
    standard = {"force_error": record["force_error"] / record["force_bias"]}
    if "range_noise" in task.drawn:
        error = record["distance_estimate"] - record["distance"] - record["range_bias"]
        standard["distance_estimate"] = error / record["range_noise"]
    normal = {name: 0.5 + 0.5 * np.vectorize(math.erf)(values / math.sqrt(2.0)) for name, values in standard.items()}
    return uniform | normal | {"noise_seed": record["noise_seed"] * 2.0**-53}


def test_numbers_are_drawn_evenly_and_independently():
    here = set()
    for options in ALL_DRAWN.values():
        envs = gym.make_vec(ID, num_envs=EPISODES, **options)
        envs.reset(seed=5)
        uniform = shares(Task(**options), envs.unwrapped.batch.info()["record"])
        here |= uniform.keys()
        for quantity, values in uniform.items():
            assert 0.0 <= values.min() <= values.max() <= 1.0, quantity
            assert kstest(values, "uniform").pvalue > 1e-4, quantity
        correlation = np.corrcoef([*uniform.values()]) - np.eye(len(uniform))
        assert np.abs(correlation).max() < 5 / math.sqrt(EPISODES)
    assert {row.id for row in QUANTITIES.values() if row.draw} == here


@pytest.mark.parametrize("arguments", ALL_DRAWN.values(), ids=list(ALL_DRAWN))
def test_critic_observes_drawn_numbers_on_their_scales(arguments):
    noisy = "range_noise" in arguments
    envs = gym.make_vec(ID, num_envs=200, privileged=True, observe_range_noise=noisy, **arguments)
    observations = envs.reset(seed=1)[0]
    spec, record = envs.unwrapped.observation_spec, envs.unwrapped.batch.info()["record"]
    hidden = [*["distance_estimate"] * (not noisy), "force_error", "noise_seed"]  # without scale
    assert [name for name in record if name not in spec.ids] == hidden
    for name in record.keys() - {*hidden}:
        seen, expected = observations[:, spec.index(name)], scaled(QUANTITIES[name].scale, record[name])
        assert seen == pytest.approx(expected, rel=0, abs=1.2e-7), name  # rounding of a float32


@EVERY_ROW
def test_decoding_inverts_encoding_within_the_scale(row):
    more = {"privileged": True, "deflection_sensor": True, "past_readings": 3, "alarm": "reading"}
    every = [options | more | {"observe_range_noise": "range_noise" in options} for options in ALL_DRAWN.values()]
    specs = (ObservationSpec(Task(**options)) for options in every)  # together, they have every observed quantity
    spec = next((spec for spec in specs if row.id in spec.ids), None)
    assert (spec is None) == (row.scale is table.NEVER_OBSERVED)
    if spec is None:
        return
    scale = spec.scale(row.id)
    bend = np.geomspace if scale.curve == "log" else np.linspace
    values = bend(scale.low, scale.high, 41)
    observation = np.zeros((41, len(spec)))
    observation[:, spec.index(row.id)] = spec.encode(row.id, values)
    assert spec.encode(row.id, values) == pytest.approx(scaled(scale, values), rel=0, abs=1e-14)
    assert spec.decode(observation, row.id) == pytest.approx(values, rel=1e-12, abs=1e-12)
    assert spec.encode(row.id, scale.high + abs(scale.high) + 1.0) == 1.0
    assert spec.entries[spec.index(row.id)].unit == row.unit


def test_paths_and_places_of_draws_never_change():
    of_others = ("operator.", "uplink.", "downlink.", "range_sensor.")
    assert {*NUMBERS, "robot.position"} == {path for path in table.BY_PATH if not path.startswith(of_others)}
    assert [row.draw.place for row in (*SCENARIO, *EPISODE)] == [0, 1, 2, 3, 4, 5, 7, 8, 10]
    assert QUANTITIES["noise_seed"].limits.at_most == 2.0**53  # up to here a float can be any whole number
