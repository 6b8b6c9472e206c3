"""Films that compare an attempt with variants. A variant has another assistance, another coupling, or no delay."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from agents.setups import load_setup
from experiments.lab import player
from experiments.lab.player.films import COLUMNS, scene_of
from experiments.play.assistance import COUPLINGS, PERIOD, record_of, related, usual
from experiments.play.attempts import ROUNDING, Attempt, Live, replayed
from experiments.play.clock import HOLD
from impact_gym.teleop.channels import WAYS
from impact_gym.teleop.operators import SIMPLE_REACTION

SECONDS = 7.0  # s, duration of a film
COARSE = 5.0  # factor of the film's allowed errors and time steps, so that the film is computed fast
BEFORE = 0.4  # s, simulated time from the start of the film to the first touch
SENTENCES = {
    "brake": "The brake at the arm senses the touch at once; it does not wait for you.",
    "none": "Nobody corrects you: the arm moves on until it receives that you let go.",
    "rigid": "The tool is fixed, so tool and arm strike together.",
    "spring": "On a spring the light tool strikes first. It softens the blow, not the push: it helps most "
    "if the arm stops soon.",
    "bistable": "The mechanism snaps back if the object presses hard enough, until the arm has caught up.",
    "stop": "The same try, but your hand lets go.",
    "delay": "You see the touch at once, and the arm gets your command at once.",
}
Variants = Mapping[str, tuple[Attempt, str]]
"""Attempts, each with a sentence about what is different, by names in the film."""


def again(this: Attempt) -> tuple[Variants, str]:
    """Return the player's attempt and its variants, and a sentence about the hand."""
    hand, record = Hand(this), this.record
    other, label = ("brake", "brake on") if this.assist == "none" else ("none", "no help")
    changed = {"letting go": (this, "stop")} if hand.stops else {}
    changed[label] = replace(this, assist=other), other
    for kind, setup in related(load_setup(this.setup)).items():
        if setup != this.setup:
            same = {name: value for name, value in record.items() if not name.startswith("coupling.")}
            coupled = record_of(usual(load_setup(setup))) | same
            changed[COUPLINGS[kind]] = replace(this, setup=setup, record=coupled), kind
    if record["uplink.delay"] + record["downlink.delay"] > 0.0:
        silent = {f"{way}.{name}": 0.0 for way in WAYS for name in ("delay", "jitter")}
        changed["no delay"] = replace(this, record=record | silent), "delay"
    variants = {f"Your hand, {name}": (hand.plays(new), SENTENCES[key]) for name, (new, key) in changed.items()}
    return {"You": (this, ""), **variants}, hand.words


def example(name: str) -> tuple[Variants, str]:
    """Return a model of a late hand, alone and with the brake, in the set-up `name`; and a sentence about the hand."""
    setup, hand = load_setup(name), {"type": "Trapezoid", "speed": 0.2}
    record = record_of(usual(setup) | {"delay": 0.2, "jitter": 0.0})
    record["distance"] = float(np.mean(setup.task.scenario.distance))
    alone, braked = (Live(Attempt(name, assist, 0, record, hand)).finished() for assist in ("none", "brake"))
    words = f"A hand model at 20 cm/s, 0.1 s late each way, lets go {SIMPLE_REACTION:.2f} s after it sees the touch."
    return {"A late hand alone": (alone, ""), "The same hand, brake on": (braked, SENTENCES["brake"])}, words


class Hand:
    """The hand of an attempt, which can play the variants.

    Until it sees the touch of the variant, it does what the person did before seeing the touch, and from then on what
    the person did from then on. If an assisted attempt ended before the person let go, it lets go SIMPLE_REACTION (s)
    after it sees the touch.
    """

    def __init__(self, this: Attempt) -> None:
        given = this.operator["velocity"]  # m/s, one each PERIOD
        seen = len(given) if this.result["missed"] else _seen(this.result["touch_time"], this.record)
        self.before, self.after = given[:seen], given[seen:]
        self.stops = abs(given[-1]) > HOLD and this.assist != "none"
        self.words = "In each film, your hand does what you did, and reacts to the touch as fast as you did."
        if self.stops:
            count = math.ceil(SIMPLE_REACTION / PERIOD)
            self.after = [*[*self.after, *given[-1:] * count][:count], 0.0]
            self.words = "Your try ended before you let go. In the other films, your hand lets go "
            self.words += f"{SIMPLE_REACTION:.2f} s after it sees the touch, as persons do on average."
        elif abs(given[-1]) <= HOLD:
            self.after.append(0.0)

    def plays(self, variant: Attempt) -> Attempt:
        """Return the variant as played by this hand."""
        live = _live(variant, self.before)
        while not (live.ended or live.batch.bodies().touched[0]):
            live.step()
        seen = _seen(live.batch.info(0)["touch_time"], variant.record)
        return _live(variant, [*self.before, *self.before[-1:] * seen][:seen] + self.after).finished()


def _seen(touch: float, record: Mapping[str, float]) -> int:
    """Return the number of the first command that a person can give after seeing the touch, which is at `touch` (s)."""
    return math.ceil((touch + record["downlink.delay"]) / PERIOD - ROUNDING)


def _live(variant: Attempt, given: Sequence[float]) -> Live:
    """Begin a variant with these commands (m/s), one each PERIOD; the last one is held."""
    times = [PERIOD * k for k in range(len(given))]
    return Live(replace(variant, operator={"type": "Replay", "time": times, "velocity": [*given]}))


def film(variants: Variants, words: str) -> dict[str, Any]:
    """Return `html`, a slow-motion film, `slides`: slide (m) by variant, None for a missed object, and `words`."""
    runs = {name: replayed(played) for name, (played, _) in variants.items()}
    scene = {"label": "one scenario for all", "number": 0, "compact": True, **scene_of(runs, COARSE)}
    for run, (_, sentence) in zip(scene["runs"], variants.values(), strict=True):
        run["sentence"] = sentence
    scene["clock"] = _fitted(scene)
    html = player.fragment({"contestants": list(runs), "columns": list(COLUMNS), "scenes": [scene]})
    slides = {name: None if run.info["missed"] else run.info["slide"] for name, run in runs.items()}
    return {"html": html, "slides": slides, "words": words}


def _fitted(scene: Mapping[str, Any]) -> list[list[float]]:
    """Return the clock of a film of SECONDS from BEFORE (s) before the touch: times (s) with slow-motion factors."""
    begin = max(min((run["contacts"][0][0] for run in scene["runs"] if run["contacts"]), default=0.0) - BEFORE, 0.0)
    starts, slower = np.array(scene["clock"]).T
    first = int(np.searchsorted(starts, begin, side="right")) - 1
    starts, slower = np.append(begin, starts[first + 1 :]), slower[first:]
    pace = SECONDS / float(np.diff(np.append(starts, scene["end"])) @ slower)
    return [[round(float(start), 7), float(f"{pace * each:.3g}")] for start, each in zip(starts, slower, strict=True)]
