"""The page in a real browser: what the stick sends, what the picture shows and when, and one try from key to film."""

import json
import signal

import pytest
from browser_pages import opened
from play_client import SETUP, Page, served

from experiments.play.server import HEADERS, Site


class Faked:
    """The page, with a server that the test plays and a clock that only `run` moves; `sent` has its messages."""

    def __init__(self, browser, world, **options):
        context = browser.new_context(viewport={"width": 1280, "height": 900}, **options)
        self.page, self.sent, self.problems, self.sockets = context.new_page(), [], [], []
        self.page.on("console", lambda message: self.problems.append(message.text))
        self.page.on("pageerror", lambda error: self.problems.append(str(error)))
        self.page.clock.install(time=0)
        self.page.clock.pause_at(1000)
        self.files, self.films = Site(world.session, "token", 1).files, []
        self.page.route("**/*", self.answer)
        self.page.route_web_socket("**/ws", self.connect)
        self.page.goto("http://127.0.0.1:1/token/")
        self.setup = str(world.setup)
        self.hear(*Page(world).messages)
        self.page.wait_for_selector("#go:not([disabled])")

    def answer(self, route):
        place, _, name = route.request.url.rpartition("/token/")[2].partition("/")
        self.films += [name] if place == "film" else []
        film = json.dumps({"html": "<p>film</p>", "slides": {"You": 0.1, "Your hand, brake on": 0.001}}), "application/json"
        body, kind = film if place == "film" else self.files[place]
        route.fulfill(body=body, headers=HEADERS | {"Content-Type": f"{kind}; charset=utf-8"})

    def connect(self, socket):
        self.sockets.append(socket)
        socket.on_message(lambda message: self.sent.append(json.loads(message)))

    def hear(self, *messages):
        for message in messages:
            self.sockets[-1].send(json.dumps(message))
        self.page.evaluate("0")  # comes after them

    def run(self, milliseconds):
        self.page.clock.run_for(milliseconds)

    def begin(self):
        """Let a try begin, as the server says it."""
        self.hear({"kind": "began", "setup": self.setup, "radius": 0.03})

    def frame(self, start, end, dt=0.016, touched=False, n=0, t=0.0):
        self.hear({"kind": "frame", "n": n, "t": t, "dt": dt, "touched": touched, "from": start, "to": end})

    def end(self, **result):
        entry = {"name": f"try {len(self.films)}", "setup": self.setup, "assist": "none", "delay": 0.2, "marks": [], "missed": 0.0,
                 "slide": 0.02, "done_time": 2.0, "object_velocity": 0.3} | result  # fmt: skip
        self.hear({"kind": "ended", "entry": entry})

    def velocities(self):
        """The deflections that were sent since the last call."""
        found = [message["v"] for message in self.sent if "v" in message]
        self.sent.clear()
        return found

    def pick(self, name, value):
        self.page.evaluate("([name, text]) => [...document.querySelectorAll(`[data-set=${name}]`)]"
                           ".find((each) => each.textContent === text).click()", [name, value])  # fmt: skip

    def number(self, selector, attribute):
        return float(self.page.locator(selector).first.get_attribute(attribute))


@pytest.fixture
def faked(browser, world):
    made = Faked(browser, world, has_touch=True)
    yield made
    made.page.context.close()
    assert made.problems == []


def test_keys_move_the_stick_and_let_it_go(faked):
    keys = faked.page.keyboard
    keys.down("ArrowRight")
    assert faked.sent[0]["begin"]["distance"] == pytest.approx(0.115)  # the first level: near
    assert faked.velocities() == [0.6]
    faked.begin()
    faked.run(300)
    assert faked.velocities() == [0.6] * 5  # repeated, so that the server does not take it for a silence
    for key, value in (("ArrowUp", 0.8), ("ArrowUp", 1.0), ("ArrowUp", None), ("ArrowDown", 0.8), ("ArrowLeft", 0.0)):
        faked.run(7)
        keys.down(key)
        assert faked.velocities() == ([value] if value is not None else []), key
    faked.run(7)
    keys.up("ArrowRight")
    assert faked.velocities() == [-0.8]
    keys.up("ArrowLeft")
    assert faked.velocities() == []  # too soon after the last
    faked.run(32)
    assert faked.velocities() == [0.0]
    for leaves in ("window.dispatchEvent(new Event('blur'))", "document.dispatchEvent(new Event('visibilitychange'))"):
        keys.down("d")
        faked.run(20)
        assert faked.velocities() == [0.8]
        faked.page.evaluate(leaves)
        faked.run(20)
        assert faked.velocities() == [0.0]
        keys.up("d")
    keys.press(" ")
    assert faked.sent == [{"done": 1}]


SHARES = [(1 / 3, 0.0), (0.358, 0.0), (0.36, 0.042), (0.65, 0.497), (0.96, 0.984), (0.97, 1.0), (0.999, 1.0), (0.309, -0.08),
          (0.322, 0.0), (0.18, -0.505), (0.05, -0.934), (0.03, -1.0), (0.001, -1.0)]  # place / width, deflection  # fmt: skip


def test_pointer_sets_the_stick_at_its_place(faked):
    """0 is at a third of the width; both ends are reached 3 % before the edge."""
    page, box = faked.page, faked.page.locator("#stick").bounding_box()
    touch, y = page.context.new_cdp_session(page), box["y"] + 0.5 * box["height"]
    finger = {"x": box["x"] + 0.65 * box["width"], "y": y}
    touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [finger]})
    assert "begin" in faked.sent[0]
    faked.begin()
    assert faked.velocities() == pytest.approx([0.497], abs=0.01)
    touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    faked.run(20)
    assert faked.velocities() == [0.0]
    page.mouse.move(finger["x"], y)
    assert faked.number("#stick", "aria-valuenow") == 0.0  # not pressed
    page.mouse.down()
    for share, value in SHARES:
        faked.run(20)
        page.mouse.move(box["x"] + share * box["width"], y)
        assert faked.number("#stick", "aria-valuenow") == pytest.approx(100 * value, abs=1), share
        knob = page.locator("#knob").bounding_box()
        middle = (knob["x"] + 0.5 * knob["width"] - box["x"]) / box["width"]
        assert middle == pytest.approx(share, abs=0.05)
    page.mouse.up()
    faked.run(40)
    assert faked.velocities()[-1] == 0.0


def test_gamepad_moves_the_stick(faked):
    faked.page.evaluate("""() => {
        window.pad = {axes: [0.11, 0], buttons: [{pressed: false}, {pressed: false}]};
        navigator.getGamepads = () => [null, window.pad];
    }""")
    faked.run(100)
    assert faked.sent == []
    for axis, value in ((0.56, 0.5), (1.0, 1.0), (-0.56, -0.5), (-1.0, -1.0), (0.12, 0.0), (0.0, 0.0)):
        faked.page.evaluate("axis => { window.pad.axes[0] = axis; }", axis)
        faked.run(20)
        assert [message["begin"]["setup"] for message in faked.sent if "begin" in message] == [faked.setup] * (axis == 0.56)
        if axis == 0.56:
            faked.begin()
        assert faked.velocities()[-1] == value
    faked.page.evaluate("window.pad.buttons[1].pressed = true")
    faked.run(20)
    assert {"done": 1} in faked.sent


def test_picture_moves_at_the_time_of_its_frames(faked, world):
    """Positions go from one to the next within `dt`, drawn 12 ms ahead; the speed is that of the simulated time."""
    page, (near, far) = faked.page, world.session.setups[faked.setup]["distance"]
    assert faked.page.locator(".somewhere").is_visible()
    scale = faked.number(".somewhere", "width") / (far - near)  # pixels per m
    home = faked.number("#picture .igw-tool", "x")
    faked.pick("slow", "a quarter")
    page.keyboard.press("Enter")
    faked.begin()
    faked.frame([0.0, 0.0, None], [0.02, 0.02, None], 0.2)
    began = page.evaluate("performance.now()")
    for _ in range(14):
        faked.run(16)
        passed = page.evaluate("performance.now()") - began
        moved = (faked.number("#picture .igw-tool", "x") - home) / scale
        assert moved == pytest.approx(0.02 * min((passed + 12) / 200, 1.0), abs=0.1 / scale)
    assert passed > 188
    assert page.inner_text("#speed") == "40 cm/s"  # 2 cm in 50 ms
    assert not page.locator("#picture circle.igw-object").is_visible()
    faked.frame([0.02, 0.02, 0.15], [0.0, 0.0, 0.15], 0.1, t=1.0)
    faked.run(16)
    assert page.inner_text("#speed") == "\u221280 cm/s"
    assert page.inner_text("#clock") == "3.0 s left"
    ball = page.locator("#picture circle.igw-object")
    radius = 0.03 * scale
    assert faked.number("#picture circle.igw-object", "cx") - radius - (home + 0.034 * scale) == pytest.approx(0.15 * scale, abs=1)
    assert (ball.is_visible(), page.locator(".somewhere").is_visible()) == (True, False)
    assert page.inner_text("#state") == "push until you touch"
    faked.frame([0.02, 0.02, 0.15], [0.02, 0.02, 0.16], touched=True)
    faked.run(16)
    assert page.inner_text("#state") == "touched: let go!"
    assert "object moved 1.0 cm" in page.text_content("#picture")


def test_levels_end_in_free_play_and_only_good_tries_count(faked, world):
    page, (near, far) = faked.page, world.session.setups[faked.setup]["distance"]
    busy = "this computer was too busy; the try was not timed right: close other programs"
    for name, delay, seen, place in (("near", 0, True, 0.15), ("far", 0.2, True, 0.85), ("blind", 0.2, False, None)):
        assert name in page.inner_text("#rounds [aria-pressed=true]")
        assert ("the picture lags on purpose" in page.inner_text("#task")) == (delay > 0)
        for result, says in ({"missed": 1.0}, "You did not touch it."), ({"marks": [busy]}, "Does not count. This"), ({}, "It slid 2"):
            page.keyboard.press("Enter")
            (begun,) = [message["begin"] for message in faked.sent if "begin" in message]
            assert (begun["delay"], begun["seen"], begun["assist"]) == (delay, seen, "none")
            assert begun.get("distance") == (None if place is None else pytest.approx(near + place * (far - near)))
            faked.sent.clear()
            faked.begin()
            faked.end(**result)
            assert says in page.inner_text("#answer")
            page.keyboard.press("ArrowRight")
            assert faked.velocities() == []  # a key that was held too long begins no try
            faked.run(600)
    assert "free play" in page.inner_text("#rounds [aria-pressed=true]")
    page.keyboard.press("b")  # the last level again, though the page is at the next
    (begun,) = [message["begin"] for message in faked.sent if "begin" in message]
    assert (begun["assist"], begun["delay"]) == ("brake", 0.2)
    faked.begin()
    faked.end(assist="brake", slide=0.005, done_time=3.0)
    assert "Gentle! Best so far: 0.5 cm" in page.inner_text("#answer")
    page.wait_for_function("document.querySelector('#answer .again').textContent === "
                           "'You: 10.0 cm. Your hand, brake on: 1.0 mm.'")  # fmt: skip
    assert len(faked.films) == 7
    page.click("#earlier summary")
    assert busy in page.inner_text("#rows")
    page.click("#rows button >> nth=-1")
    assert faked.films[-1] == "try%200"


def test_chart_has_a_dot_for_each_try_that_counts(faked):
    """Times to the right and slides upwards, to the scale of the labels at the axes."""
    tries = [(1.0, 0.01), (2.0, 0.02), (3.0, 0.005), (9.0, 0.3)]
    for time, slide in tries:
        faked.begin()
        faked.end(done_time=time, slide=slide)
    faked.begin()
    faked.end(marks=["interrupted: the page was closed"])
    labels = faked.page.evaluate("""() => [...document.querySelectorAll("#chart .soft-text")]
        .filter(each => /^[0-9.]+$/.test(each.textContent))
        .map(each => [Number(each.textContent), Number(each.getAttribute("x")), Number(each.getAttribute("y"))])""")
    across = [(value, x) for value, x, y in labels if y > 240]
    up = [(value, y) for value, x, y in labels if x < 40]
    dots = faked.page.evaluate("""() => [...document.querySelectorAll("#chart .dot")]
        .map(each => [Number(each.getAttribute("cx")), Number(each.getAttribute("cy"))])""")
    assert len(dots) == len(tries)
    per_second = (across[-1][1] - across[0][1]) / (across[-1][0] - across[0][0])
    per_centimetre = (up[-1][1] - up[0][1]) / (up[-1][0] - up[0][0])
    for (x, y), (time, slide) in zip(dots, tries, strict=True):
        assert x == pytest.approx(across[0][1] + per_second * time)
        assert y == pytest.approx(up[0][1] - 4 + per_centimetre * 100 * slide)
    assert faked.page.locator("#chart .label").all_text_contents() == ["best"]


def test_page_says_what_went_wrong(faked):
    page = faked.page
    faked.hear({"kind": "role", "player": False, "others": 1})
    page.click("#banner button")
    assert faked.sent == [{"take": 1}]
    faked.hear({"kind": "role", "player": True, "others": 2})
    assert "2 more tabs are watching" in page.inner_text("#banner")
    page.keyboard.press("Enter")
    faked.begin()
    faked.hear({"kind": "failed", "text": "no room to write"})
    assert "no room to write" in page.inner_text("#banner")
    assert page.locator("#go").is_enabled()
    faked.sockets[0].close(code=1008, reason="too fast")
    page.wait_for_selector("#banner:has-text('too fast')")
    page.click("#banner button")
    page.wait_for_selector("#banner", state="hidden")
    assert len(faked.sockets) == 2
    faked.sockets[1].close(code=1012)
    page.wait_for_selector("#banner:has-text('The server has stopped')")


def test_page_fits_and_a_tool_finds_it_accessible(browser, world):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    faked = Faked(browser, world, reduced_motion="reduce", bypass_csp=True)
    for played in (False, True):
        if played:
            faked.begin()
            faked.frame([0.0, 0.0, 0.1], [0.0, 0.0, 0.1])
            faked.end()
            faked.page.click("#choices summary")
        for width, scheme in ((390, "light"), (1280, "dark"), (1280, "light"), (390, "dark")):
            faked.page.set_viewport_size({"width": width, "height": 844})
            faked.page.emulate_media(color_scheme=scheme)
            assert faked.page.evaluate("document.documentElement.scrollWidth") <= width
            found = axe.run(faked.page).response["violations"]
            assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []


def test_try_from_the_first_key_to_the_film_in_real_time(browser, tmp_path):
    """The server is stopped in the middle of the next."""
    with served(tmp_path / "tries", SETUP) as server:
        own = (server.address, server.address.replace("http", "ws"), "data:")
        page, problems = opened(browser, server.address, own=own)
        page.set_default_timeout(120_000)
        page.wait_for_selector("#go:not([disabled])")
        page.keyboard.down("ArrowRight")
        page.wait_for_selector("body.playing")
        page.wait_for_selector("body.touching")
        page.keyboard.up("ArrowRight")
        page.wait_for_selector("#film .igw-panel")
        (this,) = server.tries(1)
        assert this.record["uplink.delay"] == 0.0
        assert max(this.operator["velocity"]) == pytest.approx(0.3)
        assert f"done after {this.result['done_time']:.1f} s" in page.inner_text("#answer")
        page.wait_for_load_state("networkidle")  # what is being fetched as the server stops fails
        page.wait_for_timeout(700)
        page.keyboard.press("Enter")
        page.wait_for_selector("body.playing")
        server.end(signal.SIGTERM)
        page.wait_for_selector("#banner:has-text('The server has stopped')")
        page.context.close()
    assert problems == []
    assert server.tries(2)[1].marks == ["interrupted: the server was stopped"]
