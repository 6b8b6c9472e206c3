"""The page in a real browser: what the stick sends, what the picture shows and when, and one try from key to film."""

import signal

import numpy as np
import pytest
from browser_pages import opened
from numpy.polynomial import Polynomial
from play_client import SETUP, served

from experiments.play import attempts


@pytest.mark.parametrize(("faked", "hint"), [
    ({"width": 1280}, "hold \u2192, or drag the stick"), ({"width": 390}, "drag the stick"),
], indirect=["faked"])  # fmt: skip
def test_page_says_whether_it_is_connected(faked, hint):
    """A phone has no keys."""
    assert faked.before == ["connecting\u2026"] * 2
    assert (faked.text("#state"), faked.text("#go").split()[0]) == (hint, "Begin")


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
        f"Does not count. T{attempts.BUSY[1:]}.": {"slide": 0.009999, "marks": [attempts.BUSY]},
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


@pytest.mark.parametrize("faked", [{"stopped": False, "reduced_motion": "reduce", "bypass_csp": True}], indirect=True)
def test_page_fits_and_a_tool_finds_it_accessible(faked):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    faked.end()
    faked.page.click("#choices summary")
    for width, scheme in ((390, "light"), (1280, "dark")):
        faked.page.set_viewport_size({"width": width, "height": 844})
        faked.page.emulate_media(color_scheme=scheme)
        assert faked.page.evaluate("document.documentElement.scrollWidth") <= width
        found = axe.run(faked.page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []


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
