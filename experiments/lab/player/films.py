"""Films of notable scenarios: replays of all contestants in the same slow motion, with thinned time histories."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.evaluate.scenario_batch import RESULTS, Episodes, ScenarioBatch
from agents.policies import Controller
from impact_gym.couplings import Bistable
from impact_gym.envs.single import TRACE_POINTS
from impact_gym.render.chain import object_radius
from impact_gym.render.film import FRAME_RATE, History
from impact_gym.task import Task

MOST = 200  # number of rows at which `thin` stops adding rows
POSITION, VELOCITY, FORCE, DEPTH = 0.0003, 0.003, 0.005, 0.005  # allowed interpolation error / largest value

BODIES = ("flange", "tool", "object")
DECIMALS = {  # decimal places of values in s, m, m/s and N; enough for a stiff contact of 0.1 ms and 1 um penetration
    "time": 7, **{f"{body}_position": 7 for body in BODIES}, **{f"{body}_velocity": 5 for body in BODIES},
    "contact_force": 5,
}  # fmt: skip
COLUMNS = tuple(DECIMALS)
EXTREMES = (  # fields of a scenario, and what the objects with the smallest and the largest value are called
    ("object_mass", "lightest object", "heaviest object"), ("contact_stiffness", "softest contact", "stiffest contact"),
    ("distance", "nearest object", "farthest object"),
)  # fmt: skip
AFTER = 0.15  # s, simulated time that the film shows after the end of the last contact; with friction, after the rest

Columns = dict[str, NDArray[np.float64]]


def thin(columns: Columns, limits: Mapping[str, float], coarse: float = 1.0) -> NDArray[np.int64]:
    """Return the indices of the rows to keep: first, last, and the rows beside each start and end of a contact.

    Rows are added until the interpolation errors are at most `coarse` times the allowed errors, or there are MOST rows.
    """
    time, penetration = columns["time"], columns["tool_position"] - columns["object_position"]
    channels = [columns[f"{body}_position"] / (POSITION * limits["farthest"]) for body in BODIES]
    channels += [columns[f"{body}_velocity"] / (VELOCITY * limits["speed"]) for body in BODIES]
    if (depth := limits["depth"]) > 0.0:
        channels.append(columns["contact_force"] / (FORCE * limits["force"]))
        channels.append(np.clip(penetration, -depth, depth) / (DEPTH * depth))
    turns = np.flatnonzero(np.diff(penetration > 0.0))
    rows = sorted({0, len(time) - 1, *turns.tolist(), *(turns + 1).tolist()})
    while len(rows) < min(MOST, len(time)):
        missed = np.max([np.abs(values - np.interp(time, time[rows], values[rows])) for values in channels], axis=0)
        worst = int(np.argmax(missed))
        if missed[worst] <= coarse:
            break
        rows = sorted({*rows, worst})
    return np.array(rows)


def choose(baseline: Episodes, policy: Episodes) -> dict[str, int]:
    """Return the numbers of notable scenarios, which both have played, by the reason for each choice."""
    touched_by_both = ~(baseline.missed | policy.missed)
    touched = np.flatnonzero(touched_by_both) if touched_by_both.any() else np.arange(len(touched_by_both))
    ours, gain = policy.object_velocity, baseline.object_velocity - policy.object_velocity
    # how far V_p of both and the time between the touches are from their means, in standard deviations
    measures = np.stack([ours, baseline.object_velocity, policy.approach_time - baseline.approach_time])[:, touched]
    off = (measures - measures.mean(axis=1, keepdims=True)) / (measures.std(axis=1, keepdims=True) + 1e-12)
    extremes: dict[str, NDArray[Any]] = {  # the touched scenario with the largest value, if they differ
        "A typical scenario: V_p and times are close to their means": -np.abs(off).max(axis=0),
        "The controller's largest gain on the rule": gain[touched],
        "The controller's smallest gain on the rule, or largest loss": -gain[touched],
        "The controller's lowest V_p": -ours[touched],
        "The controller's highest V_p": ours[touched],
        "Most contacts": np.maximum(baseline.contact_count, policy.contact_count)[touched],
        "The highest contact force": np.maximum(baseline.peak_force, policy.peak_force)[touched],
    }
    for field, lowest, highest in EXTREMES:
        values = policy.scenario[field][touched]
        extremes |= {f"The {lowest}": -values, f"The {highest}": values}
    reasons: dict[int, list[str]] = {}
    for reason, values in extremes.items():
        if not reasons or values.min() < values.max():
            reasons.setdefault(int(touched[np.argmax(values)]), []).append(reason)
    for name, missed in (("controller", policy.missed), ("rule", baseline.missed)):
        if missed.any():
            reasons.setdefault(int(np.argmax(missed)), []).append(f"Missed by the {name}")
    return {"; ".join(texts): number for number, texts in reasons.items()}


def contacts_of(run: History) -> list[tuple[float, float]]:
    """Return start and end (s) of each contact; an unfinished contact ends with the trace."""
    return list(zip(run.touches.tolist(), np.minimum(run.partings, run.now).tolist(), strict=True))


def until(run: History, end: float) -> Columns:
    """Return the time histories up to `end` (s) or the end of the trace, whichever is earlier."""
    end, time = min(end, run.now), run.time
    before = (time < end) & np.append(True, np.diff(time) > 0.0)  # a trace has two rows at each event: keep the first
    columns = {name: run.columns[name] for name in COLUMNS}
    return {name: np.append(column[before], np.interp(end, time, column)) for name, column in columns.items()}


def clock(runs: Sequence[History], end: float, coarse: float = 1.0) -> list[list[float]]:
    """Return the parts of a film that ends at `end` (s), each as [start (s), slow-motion factor].

    The factor of a part is the largest of the factors of all `runs`.
    """
    time, stretches = 0.0, list[list[float]]()
    while time < end:
        slower = max(run.factor(time) for run in runs)
        if not stretches or slower != stretches[-1][1]:
            stretches.append([round(time, DECIMALS["time"]), slower])
        time += coarse / (FRAME_RATE * slower)
    return stretches


def films(
    contestants: Mapping[str, Controller], numbers: Mapping[str, int], played: Mapping[str, Episodes], seed: int,
    environment: Mapping[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """Return films in the form that `player.fragment` takes. RuntimeError: a replay fails or differs from `played`.

    The first of `contestants` is the baseline. `numbers` is the result of `choose`; `played` has the results of
    `ScenarioBatch.play` in `environment`, by contestant. The episode of scenario k has the seed `seed` + k.
    """
    scenes = []
    for label, number in numbers.items():
        runs = {}
        for name, controller in contestants.items():
            record = {field: float(values[number]) for field, values in played[name].scenario.items()}
            runs[name] = play(controller, seed, number, record, {"scenario": "test", **environment})
            judged, replayed = float(played[name].object_velocity[number]), runs[name].info["object_velocity"]
            if abs(replayed - judged) > 0.0:
                raise RuntimeError(f"scenario {number}: the replay of {name!r} leaves the object at {replayed!r} m/s, "
                                   f"but the recorded result is {judged!r} m/s")  # fmt: skip
        scenes.append({"label": label, "number": number, **scene_of(runs)})
    return {"contestants": list(contestants), "columns": list(COLUMNS), "scenes": scenes}


def play(
    controller: Controller, seed: int, number: int, record: Mapping[str, float], options: Mapping[str, Any]
) -> History:
    """Play scenario `number` as `ScenarioBatch` does, and return its history."""
    scenario = ScenarioBatch(seed + number, 1, Task(**options), threads=1, quiet=True, trace_points=TRACE_POINTS)
    scenario.play(controller, record)
    return scenario.batch.history(0)


def scene_of(runs: Mapping[str, History], coarse: float = 1.0) -> dict[str, Any]:
    """Return a scenario for `fragment`: clock, limits, histories; `coarse` multiplies allowed errors and time steps."""
    touching = [run for run in runs.values() if run.touches.size]
    rests = [run.info.get("rest_time", contacts_of(run)[-1][1]) + AFTER for run in touching]
    end = round(max(rests + [run.now for run in runs.values() if not run.touches.size]), DECIMALS["time"])
    histories = {name: until(run, end) for name, run in runs.items()}
    all_of = {name: np.concatenate([columns[name] for columns in histories.values()]) for name in COLUMNS}
    velocities = np.concatenate([all_of[f"{body}_velocity"] for body in BODIES])
    last = [run.at(run.now) for run in runs.values()]
    limits = {
        "force": float(all_of["contact_force"].max()), "rearmost": float(all_of["flange_position"].min()),
        "speed": max(1e-3, float(np.abs(velocities).max())), "lowest": float(velocities.min()),
        "depth": max(0.0, float((all_of["tool_position"] - all_of["object_position"]).max())),
        "farthest": max(at.object_position + at.object_velocity * max(end - at.time, 0.0) for at in last),
    }  # fmt: skip
    scenario = next(iter(runs.values())).info["scenario"]
    films = [_run(name, run, histories[name], limits, coarse) for name, run in runs.items()]
    return {"scenario": scenario, "radius": object_radius(scenario["object_mass"]), "end": end,
            "clock": clock(list(runs.values()), end, coarse), "limits": limits, "runs": films}  # fmt: skip


def _run(name: str, run: History, columns: Columns, limits: Mapping[str, float], coarse: float) -> dict[str, Any]:
    alarm, digits = float(run.events.alarm), DECIMALS["time"]
    operated = {}
    if run.task.operator:
        delay = run.info["record"].get("downlink.delay", run.task.downlink.delay)
        rest = run.info["rest_time"] if run.touches.size else None
        operated = {"late": delay, "rest_time": rest, **{name: run.info[name] for name in ("slide", "done_time")}}
    rows = thin(columns, limits, coarse)
    rows = rows[np.append(True, np.diff(np.round(columns["time"][rows], digits)) > 0.0)]
    return {
        "name": name, "chain": chain_of(run.task), **{field: run.info[field] for field in RESULTS}, **operated,
        "contacts": [[round(instant, digits) for instant in contact] for contact in contacts_of(run)],
        "alarm": round(alarm, digits) if np.isfinite(alarm) else None,
        "rows": [np.round(columns[key][rows], decimals).tolist() for key, decimals in DECIMALS.items()],
    }  # fmt: skip


def chain_of(task: Task) -> dict[str, Any]:
    """Return kind and dimensions (m) of the coupling, and whether the robot is compliant."""
    coupling = task.coupling
    rest = coupling.drawn_length(task.tool_mass)
    chain = {"coupling": coupling.drawing, "rest": rest, "compliant_robot": task.robot is not None}
    if isinstance(coupling, Bistable):
        chain |= {"height": coupling.height, "front_stop": coupling.front_stop, "rear_stop": coupling.rear_stop}
    return chain
