"""The films of the page: the hand that they show, and what stands beside it."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from play_client import Page

from experiments.play import attempts, contest
from experiments.play.assistance import PERIOD, record_of
from experiments.play.attempts import Attempt, Live
from experiments.play.clock import HOLD
from impact_gym.teleop.operators import SIMPLE_REACTION


class Devices:
    """Ways to push the stick of a page, and to let it go."""

    def __init__(self, page, rng):
        self.page, self.rng, self.box = page, rng, page.locator("#stick").bounding_box()
        self.send = page.context.new_cdp_session(page).send

    def finger(self, down):
        x = self.box["x"] + self.rng.uniform(0.5, 0.97) * self.box["width"]
        at = [{"x": x, "y": self.box["y"] + 0.5 * self.box["height"]}]
        self.send("Input.dispatchTouchEvent", {"type": "touchStart" if down else "touchEnd", "touchPoints": at * down})

    def gamepad(self, down):
        self.page.evaluate("axis => fake.pad(axis)", self.rng.uniform(0.3, 1.0) * down)

    def keyboard(self, down):
        if down:
            self.page.keyboard.press(self.rng.choice(["ArrowUp", "ArrowDown"]))
        (self.page.keyboard.down if down else self.page.keyboard.up)("ArrowRight")


def hand_in(variant, this, stop):
    """What the person of a try does in a variant (m/s), where the hand lets go `stop` (s) after it sees the touch."""
    given, hand = this.operator["velocity"], []
    saw, sees = (each.result["touch_time"] + each.record["downlink.delay"] for each in (this, variant))
    saw, sees = (PERIOD * math.ceil(at / PERIOD - 1e-6) for at in (saw, sees))  # the next command
    for k in range(round(8.0 / PERIOD)):
        now = PERIOD * k
        then = min(now, saw - PERIOD) if now < sees - 1e-9 else now - sees + saw
        known = given[min(round(then / PERIOD), len(given) - 1)]
        over = now - sees >= stop or (then > PERIOD * (len(given) - 0.5) and abs(known) <= HOLD)
        hand.append(0.0 if over and now > sees - 1e-9 else known)
    return hand


@pytest.mark.parametrize("device", ["keyboard", "finger", "gamepad"])
def test_films_show_exactly_the_recorded_hand(faked, world, device):
    """20 random tries, let go before the touch, after it, and after the end, beside simulations of the commands."""
    rng, ends = np.random.default_rng(7), set()
    push, page = getattr(Devices(faked.page, rng), device), Page(world)
    for seed in range(20):
        assist = ("nobody", "a brake at the arm")[seed % 2]
        for name, text in (("assist", assist), ("delay", rng.choice(["0 ms", "200 ms"]))):
            faked.ask("pick(given)", name, text)
        faked.ask("said()")
        push(True)
        faked.run(40)
        begun, *said = faked.ask("said()")
        faked.begin()
        faked.run((250, 500, 900, 1400, 4400)[seed // 2 % 5])
        push(False)
        faked.run(200)
        for sent in (*said, *faked.ask("said()")):
            world.call_at(world.now + 0.001 * (sent["at"] - begun["at"]), world.session.handle, page, {"v": sent["v"]})
        del begun["begin"]["setup"]
        this = world.play(page, seed=seed, **begun["begin"])
        world.sleep(5.0)
        faked.end()
        faked.run(600)
        variants, words = contest.again(this)
        held, touch = abs(this.operator["velocity"][-1]) > HOLD, not this.result["missed"]
        ends.add((held, touch, assist))
        stop = SIMPLE_REACTION if held and assist != "nobody" else math.inf
        assert (f"{SIMPLE_REACTION:.2f} s after it sees the touch" in words) == (stop < math.inf)
        for name, (variant, _) in variants.items():
            hand = this.operator["velocity"] if name == "You" else hand_in(variant, this, stop)
            operator = {"type": "Replay", "time": [PERIOD * k for k in range(len(hand))], "velocity": hand}
            simulated = Live(replace(variant, operator=operator)).finished().result
            assert attempts.replayed(variant).info["slide"] == pytest.approx(simulated["slide"], abs=1e-9)
    assert ends >= {(held, True, assist) for held in (True, False) for assist in ("nobody", "a brake at the arm")}


def test_first_film_shows_a_brake_that_meets_the_goal():
    """The model of a hand slides the object farther than 1 cm alone, less with the brake."""
    alone, braked = (this.result["slide"] for this, _ in contest.example("teleop-rigid")[0].values())
    assert braked < 0.01 < alone


PUSHES = [  # speed near the object (m/s), duration of the push (s); they make slides of 0.1 mm to 3 m
    (0.02, 2.0765), (0.02, 2.1), (0.03, 1.9), (0.05, 1.4), (0.1, 1.2), (0.3, 2.0), (0.5, 3.0), (0.5, 6.6),
]  # fmt: skip


def test_captions_of_films_are_not_cut_and_agree(faked):
    """Head, caption at the end and simulation, in films of a push each and of all together."""
    record = record_of({"delay": 0.0, "jitter": 0.0}) | {"distance": 0.2}
    runs = {}
    for speed, until in PUSHES:
        commands = {"time": [0.0, 0.1, 0.6, 0.65, until, until + 0.01], "velocity": [0.0, 0.3, 0.3, speed, speed, 0.0]}
        this = Live(Attempt("teleop-rigid", "none", 3, record, {"type": "Replay", **commands})).finished()
        runs[f"push {until:g} s"] = this, "What happens."
    slides = np.array([this.result["slide"] for this, _ in runs.values()])
    assert (slides.min(), slides.max()) == (pytest.approx(1e-4, rel=0.1), pytest.approx(3.0, rel=0.1))
    for shown in (runs, *({name: run} for name, run in runs.items())):
        faked.files["film"] = json.dumps(contest.film(shown, "The hand.")), "application/json"
        faked.end()
        faked.wait(f"document.querySelector('#film .igw-panel:last-child h3')?.textContent === '{[*shown][-1]}'")
        faked.wait(f"document.querySelectorAll('#film .igw-panel').length === {len(shown)}")
        for width in (390, 768, 1280):
            faked.page.set_viewport_size({"width": width, "height": 800})
            wide = "document.querySelector('.igw-panel header').clientWidth"
            faked.wait(f"document.querySelector('.igw-chain').clientWidth === {wide}")
            for share in (0.0, 0.2, 0.5, 0.7, 1.0):
                faked.ask("seek(given)", share)
                assert faked.ask("cut(given)", "#film") == []
            texts = faked.page.locator("#film header strong").all_inner_texts()
            heads = [text.removeprefix("object slides ").partition(",")[0] for text in texts]
            captions = faked.page.locator("#film .igw-chain .igw-object-text:visible").all_text_contents()
            assert captions == [f"slid {length}" for length in heads]  # and none says that the object still moves
            for length, (this, _) in zip(heads, shown.values(), strict=True):
                number, unit = length.split()
                digits, in_unit = len(number.partition(".")[2]), this.result["slide"] * {"mm": 1e3, "cm": 1e2}[unit]
                assert float(number) == pytest.approx(in_unit, abs=0.5 / 10**digits)
