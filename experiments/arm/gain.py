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
from impact_gym.scene import Contact, Object, Scene, SpringDamper, Tool
from impact_gym.task import Task

SETUP, WEIGHT = "linear-blind", 1.65  # m/s per s: there policy and profile arrive about as late as the rule
AHEAD, BEHIND = 0.36, 0.14  # m, of a line that all scenarios and their brakes fit on
RULE = "paper's rule"
BATCH = 20
FARTHEST = 0.35  # m


def contestants() -> dict[str, Any]:
    """Return who plays."""
    return {
        RULE: PaperTrapezoid(),
        "blind profile": load_baseline("blind-profile", WEIGHT),
        "policy": load_policy(SETUP),
    }


def played(arm: str, first: int, count: int) -> Result:
    """Return a row for each of the scenarios from `first` on and each contestant."""
    made, approach = approach_of(arm, 0, 1.0, AHEAD, BEHIND)
    environment = {**load_setup(SETUP).environment, "robot": approach.robot_table("held"), "time_weight": WEIGHT}
    env, task, rows = ImpactApproachEnv(**environment), Task(**environment), list[Row]()
    for name, controller in contestants().items():
        controller = controller.for_environment(environment) if hasattr(controller, "for_environment") else controller
        before, _, _ = _commands(env, task, controller, TEST_SEED, {"distance": FARTHEST})
        for scenario in range(first, first + count):
            commands, alarm, info = _commands(env, task, controller, TEST_SEED + scenario, {})
            drawn = info["scenario"]
            after = tuple((t - alarm, v, a) for t, v, a in commands if t >= alarm - 1e-9)
            stop = after[-1][0] + task.control_period if after else 0.0
            reaction = whole.Reaction(before, (*after, (stop, 0.0, task.acceleration_range[1])), 1.0, 0.016)
            contact = Contact(drawn["contact_stiffness"], drawn["restitution"])
            scene = Scene(Tool(0.125), Object(drawn["object_mass"], drawn["distance"]), contact, SpringDamper(50.0))
            blow = whole.simulate(made, approach, scene, reaction, duration=info["approach_time"] + 0.35, rtol=1e-7)
            rows.append({
                "arm": arm, "contestant": name, "scenario": scenario, "chain": info["object_velocity"],
                "chain_time": info["approach_time"], "whole": blow.object_velocity, "whole_time": blow.touch_time,
                "status": blow.status,
            })  # fmt: skip
    return result_of(rows)


def _commands(
    env: ImpactApproachEnv, task: Task, controller: Any, seed: int, record: dict[str, float]
) -> tuple[tuple[whole.Command, ...], float, Any]:
    """Return an episode's commands with the times of their steps, when the alarm came (s), and its last info."""
    observation, info = env.reset(seed=seed, options={"record": record})
    commands = list[whole.Command]()
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
    return velocity, acceleration


def rows(gather: Gather, arms: Sequence[str], count: int) -> list[Row]:
    """Return the rows of all arms."""
    cells = [{"arm": arm, "first": first, "count": BATCH} for arm in arms for first in range(0, count, BATCH)]
    return gather("gain", played, cells, solver_and("experiments.arm", "agents.baselines", "agents.policies"))


def table(found: Sequence[Row]) -> list[dict[str, Any]]:
    """Return for each arm and contestant V_p and time on chain and whole arm, and how far below the rule that is."""
    lines = list[dict[str, Any]]()
    for arm in dict.fromkeys(row["arm"] for row in found):
        mine = [row for row in found if row["arm"] == arm]
        resamples = Resamples(len({row["scenario"] for row in mine}))
        means: dict[tuple[str, str], Any] = {}
        for name in dict.fromkeys(row["contestant"] for row in mine):
            line: dict[str, Any] = {"arm": arm, "contestant": name}
            for column in ("chain", "whole", "chain_time", "whole_time"):
                values = np.array([row[column] for row in mine if row["contestant"] == name])
                means[name, column] = resamples.means(values[None])
                line[column] = estimate(means[name, column])
            for column in ("chain", "whole"):
                line[f"less_{column}"] = estimate(1.0 - means[name, column] / means[RULE, column])
            gone: Estimate = estimate(
                means[name, "whole"] / means[RULE, "whole"] - means[name, "chain"] / means[RULE, "chain"]
            )
            lines.append(line | {"lost": gone})
    return lines
