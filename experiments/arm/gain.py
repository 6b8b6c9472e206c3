"""Does the gain hold on the whole arm? Rule, profile and policy on the chain and on all joints, scenario by scenario.

A controller that is blind decides before the alarm by its own motion alone, so that what it commands is the same on
every arm until then; what it commands after the alarm is taken from the chain, from the arm's own alarm on.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.baselines import PaperTrapezoid, load_baseline
from agents.evaluate import TEST_SEED
from agents.jobs import Result
from agents.policies import load_policy
from agents.setups import load_setup
from experiments.arm.robots import approach_of
from experiments.lab.statistics import Estimate, Resamples, estimate
from experiments.lab.tables import Gather, Row, result_of, solver_and
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.robot import whole
from impact_gym.robot.drive import Command
from impact_gym.scene import Contact, Object, Scene, Tool
from impact_gym.task import Task

WEIGHTS = {"linear-blind": 1.5, "bistable-blind": 0.9, "rigid-blind": 3.2}
"""Set-ups, and the time weight, m/s per s, at which profile and policy arrive about as late as the rule does."""
AHEAD = 0.36  # m, of a line that all scenarios fit on
RULE = "paper's rule"
BATCH, SCENARIOS = 25, 500
FARTHEST = 0.35  # m
RTOL = 1e-5  # V_p is within 3e-5 m/s of that at 1e-11


def played(arm: str, setup: str, first: int, count: int) -> Result:
    """Return a row for each of the scenarios from `first` on and each contestant."""
    weight, made = WEIGHTS[setup], load_setup(setup)
    contestants = {
        RULE: PaperTrapezoid(), "profile": load_baseline(made.against[0], weight), "policy": load_policy(setup),
    }  # fmt: skip
    whole_arm, approach = approach_of(arm, 0, ahead=AHEAD)
    environment = {**made.environment, "robot": approach.robot_table("held"), "time_weight": weight}
    env, task, rows = ImpactApproachEnv(**environment), Task(**environment), list[Row]()
    for name, controller in contestants.items():
        controller = controller.for_environment(environment) if hasattr(controller, "for_environment") else controller
        before, _, _ = _commands(env, task, controller, TEST_SEED, {"distance": FARTHEST})
        flight: whole.Flight = []  # until the touch all scenarios are one
        for scenario in range(first, first + count):
            row: Row = {"arm": arm, "setup": setup, "contestant": name, "scenario": scenario, "chain": np.nan,
                        "chain_time": np.nan, "whole": np.nan, "whole_time": np.nan}  # fmt: skip
            try:
                commands, alarm, info = _commands(env, task, controller, TEST_SEED + scenario, {})
                drawn, duration = info["scenario"], info["approach_time"] + 0.35
                row |= {"chain": info["object_velocity"], "chain_time": info["approach_time"]}
                after = tuple((t - alarm, v, a) for t, v, a in commands if t >= alarm - 1e-9)
                stop = after[-1][0] + task.control_period if after else 0.0
                brake = (stop, 0.0, task.acceleration_range[1])
                reaction = whole.Reaction(before, (*after, brake), task.alarm_threshold, task.reaction_delay)
                contact = Contact(drawn["contact_stiffness"], drawn["restitution"])
                scene = Scene(Tool(0.125), Object(drawn["object_mass"], drawn["distance"]), contact, task.coupling)
                blow = whole.simulate(whole_arm, approach, scene, reaction, duration=duration, rtol=RTOL, flight=flight)
                row |= {"whole": blow.object_velocity, "whole_time": blow.touch_time or np.nan, "status": blow.status}
            except (ValueError, RuntimeError) as problem:
                row["status"] = " ".join(str(problem).split())
            rows.append(row)
    return result_of(rows)


def _commands(
    env: ImpactApproachEnv, task: Task, controller: Any, seed: int, record: dict[str, float]
) -> tuple[tuple[Command, ...], float, Any]:
    """Return an episode's commands with the times of their steps, when the alarm came (s), and its last info."""
    observation, info = env.reset(seed=seed, options={"record": record})
    commands = list[Command]()
    state, start, ended, alarm = None, np.ones(1, np.bool_), False, np.inf
    while not ended:
        sensors = env.sensors()
        if sensors["alarm"] and np.isinf(alarm):
            alarm = float(sensors["time"])
        actions, state = controller.predict(observation[None], state=state, episode_start=start, deterministic=True)
        commands.append((float(sensors["time"]), *_decoded(np.asarray(actions)[0], task)))
        observation, _, ended, _, info = env.step(np.asarray(actions)[0])
        start = np.zeros(1, np.bool_)
    return tuple(commands), alarm, info


def _decoded(action: Any, task: Task) -> tuple[float, float]:
    """Return the velocity (m/s) and the acceleration (m/s^2) that an action commands."""
    velocity, acceleration = (
        low + 0.5 * (float(each) + 1.0) * (high - low)
        for each, (low, high) in zip(action, (task.velocity_range, task.acceleration_range), strict=True)
    )
    return round(velocity, 6), round(acceleration, 6)  # as the environment does


def rows(gather: Gather, arms: Sequence[str], setups: Sequence[str], count: int) -> list[Row]:
    """Return the rows of all arms and set-ups."""
    cells = [{"arm": arm, "setup": setup, "first": first, "count": BATCH}
             for arm in arms for setup in setups for first in range(0, count, BATCH)]  # fmt: skip
    depends = solver_and("experiments.arm.gain", "experiments.arm.robots", "agents.baselines", "agents.policies")
    return gather("gain", played, cells, depends)


def table(found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each arm, set-up and contestant V_p and time on chain and whole arm, and how far below the rule.

    Counted are the scenarios in which all contestants have a result on both.
    """
    lines = list[dict[str, Any]]()
    for arm, setup in dict.fromkeys((row["arm"], row["setup"]) for row in found):
        mine = [row for row in found if (row["arm"], row["setup"]) == (arm, setup)]
        numbers = ("chain", "whole", "chain_time", "whole_time")
        bad = {row["scenario"] for row in mine if row["status"] != "ok" or np.isnan([row[n] for n in numbers]).any()}
        mine, all_of_them = [row for row in mine if row["scenario"] not in bad], {row["scenario"] for row in mine}
        if not mine:
            continue
        resamples = Resamples(len(all_of_them - bad))
        means: dict[tuple[str, str], Any] = {}
        for name in dict.fromkeys(row["contestant"] for row in mine):
            line: dict[str, Any] = {"arm": arm, "setup": setup, "contestant": name, "left_out": len(bad)}
            for column in numbers:
                values = np.array([row[column] for row in mine if row["contestant"] == name])
                means[name, column] = resamples.means(values[None])
                line[column] = estimate(means[name, column])
            for column in ("chain", "whole"):
                line[f"less_{column}"] = estimate(1.0 - means[name, column] / means[RULE, column])
            gone: Estimate = estimate(
                means[name, "whole"] / means[RULE, "whole"] - means[name, "chain"] / means[RULE, "chain"]
            )
            lines.append(line | {"lost": gone, "count": resamples.scenarios})
    return lines
