"""The page in a real browser: what the stick sends, what the picture shows and when, and one try from key to film."""

import json
import math
import signal
from dataclasses import replace
from pathlib import Path

import numpy as np
import play_client
import pytest
from browser_pages import opened
from numpy.polynomial import Polynomial
from play_client import SETUP, Page, served

from experiments.play import attempts, contest
from experiments.play.assistance import PERIOD, record_of
from experiments.play.attempts import BUSY, Attempt, Live
from experiments.play.clock import HOLD
from experiments.play.server import HEADERS, Site
from impact_gym.teleop.operators import SIMPLE_REACTION

SLIDES = {"You": 0.1, "Your hand, brake on": 0.0009}
FILM = json.dumps({"html": "<p></p>", "slides": SLIDES, "words": "The hand."}), "application/json"


class Faked:
    """The page, with a server that the test plays (faked_page.js), and a clock that only `run` moves."""

    def __init__(self, browser, world, stopped=True, **options):
        self.setup, self.files = str(world.setup), {**Site(world.session, "token", 1).files, "film": FILM}
        self.page, self.problems = opened(browser, "about:blank", own=("http://127.0.0.1:1/", "data:"), **options)
        if stopped:
            self.page.clock.install(time=0)
            self.page.clock.pause_at(1000)
        self.page.add_init_script(path=Path(play_client.__file__).with_name("faked_page.js"))
        self.page.route("**/*", self.answer)
        self.page.goto("http://127.0.0.1:1/token/")
        self.before = [self.page.inner_text(f"#{part}") for part in ("state", "go")]
        self.hear(*Page(world).messages)
        self.run, self.text = self.page.clock.run_for, self.page.inner_text

    def answer(self, route):
        body, kind = self.files[route.request.url.rpartition("/token/")[2].partition("/")[0]]
        route.fulfill(body=body, headers=HEADERS | {"Content-Type": f"{kind}; charset=utf-8"})

    def ask(self, what, *given):
        return self.page.evaluate(f"given => fake.{what}", given[0] if len(given) == 1 else [*given])

    def hear(self, *messages):
        self.page.evaluate("given => fake.hear(given)", [*messages])

    def wait(self, condition):
        """Wait until a condition holds; `wait_for_function` would break the page's security policy."""
        for _ in range(1000):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(20)
        raise TimeoutError(condition)

    def said(self, word):
        """The values with this word of the messages since the last call."""
        return [message[word] for message in self.ask("said()") if word in message]

    def begin(self):
        self.hear({"kind": "began", "setup": self.setup, "radius": 0.03})

    def frame(self, start, end, dt=0.016, touched=False):
        self.hear({"kind": "frame", "n": 0, "t": 1.0, "dt": dt, "touched": touched, "from": start, "to": end})
        self.run(32)  # the first picture may be drawn at once, the second 16 ms later

    def end(self, times=1, **result):
        entry = {"name": "try 1", "setup": self.setup, "assist": "none", "delay": 0.2, "marks": [], "missed": 0.0,
                 "slide": 0.02, "done_time": 2.0, "object_velocity": 0.3} | result  # fmt: skip
        self.hear(*[{"kind": "ended", "entry": entry}] * times)


@pytest.fixture
def faked(browser, world):
    made = Faked(browser, world, has_touch=True)
    yield made
    made.page.context.close()
    assert made.problems == []


def test_page_says_whether_it_is_connected(faked):
    assert faked.before == ["connecting\u2026"] * 2
    assert (faked.text("#state"), faked.text("#go").split()[0]) == ("hold \u2192, or drag the stick", "Begin")


def test_keys_move_the_stick_and_let_it_go(faked):
    keys = faked.page.keyboard
    keys.down("d")
    (begun,) = faked.said("begin")
    assert begun["distance"] == pytest.approx(0.115)  # the first level: near
    faked.begin()
    faked.run(300)
    assert faked.said("v") in ([0.6] * 4, [0.6] * 5)  # repeated, so that the server does not take it for a silence
    for key, value in (("ArrowUp", 0.8), ("ArrowUp", 1.0), ("ArrowUp", 1.0), ("ArrowDown", 0.8)):
        keys.press(key)
        faked.run(70)
        assert {*faked.said("v")} >= {value}
    keys.up("d")
    for key, leaves, name in (("d", "window", "blur"), ("a", "document", "visibilitychange")):
        faked.run(80)
        assert faked.said("v")[-1] == 0.0
        keys.down(key)
        faked.run(20)
        assert faked.said("v")[-1] == {"d": 0.8, "a": -0.8}[key]
        faked.page.evaluate(f"{leaves}.dispatchEvent(new Event('{name}'))")
    faked.run(20)
    assert faked.said("v")[-1] == 0.0
    keys.press(" ")
    assert faked.said("done") == [1]


@pytest.mark.parametrize("device", ["mouse", "finger"])
def test_pointer_sets_the_stick_at_its_place(faked, device):
    """0 is at a third of the width; both ends are reached 3 % before the edge."""
    page, box = faked.page, faked.page.locator("#stick").bounding_box()
    send = page.context.new_cdp_session(page).send
    finger = lambda kind, *at: send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": at})  # noqa: E731
    ahead = (1 / 3, 0.0), (0.358, 0.0), (0.36, 0.042), (0.65, 0.497), (0.96, 0.984), (0.97, 1.0), (0.999, 1.0)
    for share, value in (*ahead, (0.309, -0.08), (0.322, 0.0), (0.18, -0.505), (0.05, -0.934), (0.03, -1.0)):
        x, y = box["x"] + share * box["width"], box["y"] + 0.5 * box["height"]
        page.mouse.move(x, y)  # not pressed
        assert faked.ask("number(given)", "#stick", "aria-valuenow") == 0.0
        page.mouse.down() if device == "mouse" else finger("Start", {"x": x, "y": y})
        faked.begin()
        faked.run(100)
        assert faked.said("v")[-1] == pytest.approx(value, abs=0.01)
        page.mouse.up() if device == "mouse" else finger("End")


def test_gamepad_moves_the_stick(faked):
    for axis, value in ((0.11, []), (0.56, [0.5]), (1.0, [1.0]), (-0.56, [-0.5]), (0.12, [0.0])):
        faked.ask("pad(given)", axis)
        faked.run(40)
        sent = faked.ask("said()")
        assert sum("begin" in message for message in sent) == (axis == 0.56)
        assert [message["v"] for message in sent if "v" in message][-1:] == value
        if value:
            faked.begin()


def test_picture_moves_at_the_time_of_its_frames(faked, world):
    """Positions go from one to the next within `dt`, drawn 12 ms ahead; the speed is that of the simulated time."""
    page, (near, far) = faked.page, world.session.setups[faked.setup]["distance"]
    scale = faked.ask("number(given)", ".somewhere", "width") / (far - near)  # pixels per m
    home = faked.ask("number(given)", "#picture .igw-tool", "x") / scale
    assert faked.ask("number(given)", "#picture .igw-flange", "x") > 0  # the flange is on the picture, too
    faked.ask("pick(given)", "slow", "a quarter")
    page.keyboard.press("Enter")
    faked.begin()
    began = faked.ask("watch()")
    faked.frame([0.0, 0.0, None], [0.02, 0.02, None], 0.2)
    for _ in range(14):
        drawn, tool = faked.ask("drawn") - began, faked.ask("number(given)", "#picture .igw-tool", "x") / scale
        assert tool - home == pytest.approx(0.02 * min((drawn + 12) / 200, 1.0), abs=0.1 / scale)
        faked.run(16)
    assert drawn > 188
    assert (faked.text("#speed"), faked.text("#clock")) == ("40 cm/s", "3.0 s left")  # 2 cm in 50 ms
    faked.frame([0.02, 0.02, 0.15], [0.02, 0.02, 0.15], touched=True)
    place = (faked.ask("number(given)", "#picture circle.igw-object", "cx") / scale - 0.03) - (home + 0.034)
    assert place == pytest.approx(0.15, abs=1 / scale)  # from the front of the tool to that of the object
    assert (page.locator(".somewhere").is_visible(), faked.text("#state")) == (False, "touched: let go!")
    faked.frame([0.02, 0.02, 0.15], [0.02, 0.02, 0.17], touched=True)
    for width in (1280, 700):  # a picture drawn again shows the same
        page.set_viewport_size({"width": width, "height": 800})
        faked.wait("Math.abs(picture.clientWidth - picture.viewBox.baseVal.width) < 1")
        scale = faked.ask("number(given)", ".somewhere", "width") / (far - near)
        ghost, ball, tool = (faked.ask("number(given)", f"#picture .igw-{name}", place)
                             for name, place in (("ghost", "cx"), ("object", "cx"), ("tool", "x")))  # fmt: skip
        assert ball - ghost == pytest.approx(0.02 * scale, abs=1)  # the ghost stays where the object was hit
        assert tool / scale - 0.02 == pytest.approx(home, abs=1 / scale)
    assert not page.locator("#picture :text('out of the picture')").is_visible()
    faked.end(slide=0.9)  # farther than the picture shows
    faked.run(32)
    assert (page.locator("#picture .igw-object-text").text_content(), faked.ask("cut(given)", "#stage")) == (
        "slid 90.0 cm", [],
    )  # fmt: skip
    assert page.locator("#picture :text('out of the picture')").is_visible()


def test_gentle_tries_win_the_levels_and_end_in_free_play(faked, world):
    press, (near, far) = faked.page.keyboard.press, world.session.setups[faked.setup]["distance"]
    ends = {  # what the page says of the results; the last wins, though the computer was too late to count the try
        "did not touch": {"missed": 1.0}, "It slid 1.01 cm": {"slide": 0.010001}, "It slid 2.0 cm": {},
        f"Does not count. T{BUSY[1:]}.": {"slide": 0.009999, "marks": [BUSY]},
    }  # fmt: skip
    for delay, seen, place in ((0, True, 0.15), (0.2, True, 0.85), (0.2, False, None)):
        for says, result in ends.items():
            press("Enter")
            (begun,) = faked.said("begin")
            assert (begun["delay"], begun["seen"], begun["assist"]) == (delay, seen, "none")
            assert begun.get("distance") == (None if place is None else pytest.approx(near + place * (far - near)))
            assert ("No delay" in faked.text("#task"), "200 ms" in faked.text("#task")) == (delay == 0, delay > 0)
            assert faked.page.locator(".somewhere").is_visible() != seen
            faked.begin()
            faked.end(**result)
            assert says in faked.text("#answer")
            assert ("won" in faked.text("#answer")) == ("Does not" in says)
            press("ArrowRight")
            assert faked.said("v") == []  # a key that was held too long begins no try
            faked.run(600)
        assert "It slid 0.99 cm" in faked.text("#answer")
    press("b")  # the last level again, though it is won
    (begun,) = faked.said("begin")
    assert (begun["assist"], begun["delay"]) == ("brake", 0.2)
    faked.page.wait_for_selector("#answer .again:has-text('You: 10.0 cm. Your hand, brake on: 0.9 mm.')")
    faked.begin()
    faked.end(slide=0.1)
    faked.run(600)
    press("Enter")  # a level that is won remains won
    assert "free play" in faked.text("#rounds [aria-pressed=true]")


def test_chart_has_a_dot_for_each_try_that_counts(faked):
    """Times to the right and slides upwards, to the scale of the labels at the axes."""
    tries = [(1.0, 0.01), (2.0, 0.02), (3.0, 0.005), (9.0, 0.3)]
    for time, slide in tries:
        faked.end(done_time=time, slide=slide)
    faked.end(marks=["interrupted: the page was closed"])
    labels = faked.ask("all(given)", "#chart .soft-text", "x", "y")
    numbers = [(float(text), x, y) for text, x, y in labels if text.replace(".", "").isdigit()]
    across, up = [(time, x) for time, x, y in numbers if y > 240], [(slide, y - 4) for slide, x, y in numbers if x < 40]
    x, y = (Polynomial.fit(*np.transpose(scale), 1) for scale in (across, up))
    dots = np.array([dot[1:] for dot in faked.ask("all(given)", "#chart .dot", "cx", "cy")])
    assert dots == pytest.approx(np.array([(x(time), y(100 * slide)) for time, slide in tries]), abs=0.1)
    assert dots[-1] == pytest.approx([40 + 326 / 1.08, 232 - 210 / 1.12], abs=0.1)  # the farthest, near the corner
    (best,) = (at for text, at in faked.ask("all(given)", "#chart .label", "x") if text == "best")
    assert best == pytest.approx(x(3.0), abs=0.1)
    faked.end(195, missed=1.0)
    faked.end()  # the chart has the newest 200, not the first; a ring marks the last
    assert [len(faked.ask("all(given)", f"#chart .{kind}", "cx")) for kind in ("dot", "ring")] == [4, 1]


def test_page_fits_and_a_tool_finds_it_accessible(browser, world):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    faked = Faked(browser, world, stopped=False, reduced_motion="reduce", bypass_csp=True)
    faked.end()
    faked.page.click("#choices summary")
    for width, scheme in ((390, "light"), (1280, "dark")):
        faked.page.set_viewport_size({"width": width, "height": 844})
        faked.page.emulate_media(color_scheme=scheme)
        assert faked.page.evaluate("document.documentElement.scrollWidth") <= width
        found = axe.run(faked.page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []


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
                digits = len(number.partition(".")[2])
                assert float(number) == pytest.approx(
                    this.result["slide"] * {"mm": 1e3, "cm": 1e2}[unit], abs=0.5 / 10**digits
                )


def test_try_from_the_first_key_to_the_film_in_real_time(browser, tmp_path):
    """The server is stopped in the middle of the next."""
    with served(SETUP, tmp_path) as server:
        own = (server.address, server.socket, "data:")
        page, problems = opened(browser, server.address, own=own)
        page.set_default_timeout(120_000)
        page.wait_for_selector("#go:not([disabled])")
        page.keyboard.down("ArrowRight")
        page.wait_for_selector("body.touching, #answer .big")  # a busy browser may see the touch only after its end
        page.keyboard.up("ArrowRight")
        page.wait_for_selector("#film .igw-panel")
        (this,) = attempts.of_persons(tmp_path, marked=True)
        assert max(this.operator["velocity"]) == pytest.approx(0.3)
        page.wait_for_load_state("networkidle")  # what is being fetched as the server stops fails
        page.click("#go")
        page.wait_for_selector("body.playing")
        server.end(signal.SIGTERM)
        page.wait_for_selector("#banner:has-text('The server has stopped')")
        assert page.inner_text("#state") == "no connection"
        page.context.close()
    assert problems == []
    assert attempts.of_persons(tmp_path, marked=True)[1].marks == ["interrupted: the server was stopped"]
