"""Films that compare an attempt with variants. A variant has another assistance, another coupling, or no delay."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from agents.setups import load_setup
from experiments.lab import player
from experiments.lab.player.films import COLUMNS, scene_of
from experiments.play.assistance import COUPLINGS, PERIOD, record_of, related, usual
from experiments.play.attempts import Attempt, Live, replayed
from impact_gym.teleop.channels import WAYS

SECONDS = 7.0  # s, duration of a film
COARSE = 5.0  # factor of the film's allowed errors and time steps, so that the film is computed fast
BEFORE = 0.4  # s, simulated time from the start of the slow motion to the first touch
SENTENCES = {
    "brake": "The brake at the arm senses the touch at once; it does not wait for you.",
    "none": "Nobody corrects you: the arm moves on until your command to stop arrives.",
    "rigid": "The tool is fixed, so tool and arm strike together.",
    "spring": "On a spring the light tool strikes first, and the arm pushes only through the spring.",
    "bistable": "The mechanism snaps back at the touch and takes the tool away from the object.",
    "delay": "If you had seen the touch at once, you would have let go sooner.",
}


def again(this: Attempt) -> dict[str, tuple[Attempt, str]]:
    """Return the player's attempt and its variants, each with a sentence about the difference, by names in the film."""
    record, (other, label) = this.record, ("brake", "brake on") if this.assist == "none" else ("none", "no help")
    changed = {label: (replace(this, assist=other), other)}
    for kind, setup in related(load_setup(this.setup)).items():
        if setup != this.setup:
            same = {name: value for name, value in record.items() if not name.startswith("coupling.")}
            coupled = record_of(usual(load_setup(setup))) | same
            changed[COUPLINGS[kind]] = replace(this, setup=setup, record=coupled), kind
    if record["uplink.delay"] + record["downlink.delay"] > 0.0 and not this.result["missed"]:
        changed["no delay"] = _without_delay(this), "delay"
    variants = {f"Your hand, {name}": (Live(new).finished(), SENTENCES[key]) for name, (new, key) in changed.items()}
    return {"You": (this, ""), **variants}


def _without_delay(this: Attempt) -> Attempt:
    """Leave out delays, and the commands that arrived after the touch but were sent before it was seen."""
    record, touch, velocity = this.record, this.result["touch_time"], this.operator["velocity"]
    silent = {f"{way}.{name}": 0.0 for way in WAYS for name in ("delay", "jitter")}
    sent = math.floor((touch - record["uplink.delay"]) / PERIOD)
    seen = math.ceil((touch + record["downlink.delay"]) / PERIOD)
    kept = [*velocity[: sent + 1], *(velocity[seen:] or velocity[-1:])]
    operator = {"type": "Replay", "time": [PERIOD * k for k in range(len(kept))], "velocity": kept}
    return replace(this, record=record | silent, operator=operator)


def film(variants: Mapping[str, tuple[Attempt, str]]) -> dict[str, Any]:
    """Return `html`, a slow-motion film, and `slides`: slide (m) by variant, None for a missed object."""
    runs = {name: replayed(played) for name, (played, _) in variants.items()}
    scene = {"label": "one scenario for all", "number": 0, "compact": True, **scene_of(runs, COARSE)}
    for run, (_, sentence) in zip(scene["runs"], variants.values(), strict=True):
        run["sentence"] = sentence
    scene["clock"] = _fitted(scene)
    html = player.fragment({"contestants": list(runs), "columns": list(COLUMNS), "scenes": [scene]})
    slides = {name: None if run.info["missed"] else run.info["slide"] for name, run in runs.items()}
    return {"html": html, "slides": slides}


def _fitted(scene: Mapping[str, Any]) -> list[list[float]]:
    """Return the clock of a film of SECONDS: pairs of a simulated time (s) and the slow-motion factor from then on.

    If the first touch comes later than BEFORE (s), the first tenth of the film ends BEFORE (s) before this touch.
    """
    touches = [run["contacts"][0][0] for run in scene["runs"] if run["contacts"]]
    cut = max(min(touches, default=0.0) - BEFORE, 0.0)
    starts, slower = np.array(scene["clock"]).T
    first = int(np.searchsorted(starts, cut, side="right")) - 1
    starts, slower = np.append(cut, starts[first + 1 :]), slower[first:]
    pace = (0.9 if cut else 1.0) * SECONDS / float(np.diff(np.append(starts, scene["end"])) @ slower)
    clock = [[round(float(start), 7), float(f"{pace * each:.3g}")] for start, each in zip(starts, slower, strict=True)]
    return [[0.0, float(f"{0.1 * SECONDS / cut:.3g}")], *clock] if cut else clock
