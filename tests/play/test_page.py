"""The page in a real browser: from the first key to the replay, with every device, and when something goes wrong."""

import json
import signal
import time

import pytest
from playing import READY, Tab, connect, heard, served

PAD = """() => {
  const pad = {axes: [0, 0], buttons: [{pressed: false}, {pressed: false}]};
  navigator.getGamepads = () => [pad];
  window.pad = pad;
}"""


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with served(tmp_path_factory.mktemp("play") / "tries") as running:
        yield running


@pytest.fixture
def tab(browser, server):
    opened = []

    def open_tab(**options):
        opened.append(Tab(browser, server, **options))
        return opened[-1]

    yield open_tab
    for each in opened:
        each.context.close()
        assert each.problems == []


def kept(server, count):
    """Return the tries once there are so many."""
    while len(found := server.tries()) < count:
        time.sleep(0.05)
    return found


def test_try_from_the_first_key_to_the_replay(tab, server):
    before = len(server.tries())
    page = (one := tab()).page
    page.wait_for_selector("#film .igw-panel")
    assert page.locator("#film h3").all_inner_texts()[:2] == ["paper's rule", "learned policy"]
    page.keyboard.down("ArrowRight")
    page.wait_for_selector("body.playing")
    assert page.locator("#picture circle.igw-object").is_hidden()
    page.wait_for_selector("body.touching", timeout=9000)
    assert page.locator("#picture circle.igw-object").is_visible()
    page.keyboard.up("ArrowRight")
    one.until_over()
    this = kept(server, before + 1)[-1]
    assert this.marks in ([], ["invalid: too many late steps"])
    said = page.inner_text("#answer")
    assert f"{this.result['done_time']:.2f} s" in said
    assert page.locator("#film h3").all_inner_texts() == ["paper's rule", "learned policy", "you"]
    assert "you" in page.locator("#chart").text_content() or this.marks
    assert "In the same scene" in said
    page.click("#earlier summary")
    page.click("#rows button >> nth=0")
    page.wait_for_selector("#film .igw-panel")
    assert this.assist == "none"


def test_film_for_those_who_only_look_lasts_ten_seconds(tab):
    page = tab().page
    page.wait_for_selector("#film .igw-panel")
    scene = json.loads(page.locator("#film .igw-films").first.text_content())["scenes"][0]
    ends = [start for start, _ in scene["clock"][1:]] + [scene["end"]]
    length = sum((end - start) * slower for (start, slower), end in zip(scene["clock"], ends, strict=True))
    assert length == pytest.approx(10.0, rel=0.01)
    assert len(scene["runs"]) == 3


@pytest.mark.parametrize("device", ["mouse", "touch", "gamepad"])
def test_every_device_steers(tab, server, device):
    before = len(server.tries())
    one = tab(has_touch=device == "touch")
    page, box = one.page, one.page.locator("#stick").bounding_box()
    x, y = box["x"] + 0.7 * box["width"], box["y"] + 0.5 * box["height"]
    if device == "mouse":
        page.mouse.move(box["x"] + box["width"] / 3, y)
        page.mouse.down()
        page.mouse.move(x, y, steps=4)
    elif device == "touch":
        touch = one.context.new_cdp_session(page)
        touch.send("Input.dispatchTouchEvent", {"type": "touchStart", "touchPoints": [{"x": x, "y": y}]})
    else:
        page.evaluate(PAD)
        page.evaluate("() => { window.pad.axes[0] = 0.6; }")
    page.wait_for_selector("body.playing")
    page.wait_for_timeout(500)
    assert 20 < int(page.get_attribute("#stick", "aria-valuenow")) < 90
    page.wait_for_selector("body.touching", timeout=9000)
    if device == "mouse":
        page.mouse.up()
    elif device == "touch":
        touch.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})
    else:
        page.evaluate("() => { window.pad.axes[0] = 0; }")
    one.until_over()
    assert page.get_attribute("#stick", "aria-valuenow") == "0"
    velocities = kept(server, before + 1)[-1].operator["velocity"]
    assert 0.1 < max(velocities) < 0.45
    assert velocities[-1] == 0.0


def test_keyboard_alone_chooses_begins_and_ends(tab, server):
    before = len(server.tries())
    page = tab().page
    page.focus("#assist")
    page.keyboard.press("ArrowDown")  # moves what has the focus, and begins nothing
    assert page.input_value("#assist") == "brake"
    page.focus("#delay")
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    assert page.inner_text("#delay-value") == "250 ms"
    page.focus("#stick")
    page.keyboard.press("ArrowDown")
    assert page.inner_text("#level") == "40 %"
    page.keyboard.press("Enter")
    page.wait_for_selector("body.playing")
    page.keyboard.down("ArrowRight")
    page.wait_for_timeout(400)
    page.keyboard.up("ArrowRight")
    page.wait_for_timeout(600)
    assert page.locator("body.playing").count() == 1  # a pause does not end it
    page.keyboard.press(" ")
    page.wait_for_selector("body:not(.playing)")
    this = kept(server, before + 1)[-1]
    assert this.assist == "brake"
    assert this.record["uplink.delay"] == this.record["downlink.delay"] == pytest.approx(0.125)
    assert max(this.operator["velocity"]) == pytest.approx(0.4 * 0.5)
    for key in ("→", "←", "↑", "↓", "Enter", "Space"):
        assert key in page.inner_text("#keys")


def test_reload_in_the_middle_keeps_the_try_and_the_page_goes_on(tab, server):
    before = len(server.tries())
    one = tab()
    page = one.page
    page.keyboard.down("ArrowRight")
    page.wait_for_selector("body.playing")
    page.wait_for_timeout(300)
    page.reload()
    page.wait_for_selector(READY)
    assert kept(server, before + 1)[-1].marks[0] == "interrupted: the page was closed"
    page.keyboard.up("ArrowRight")
    page.wait_for_timeout(700)
    page.keyboard.press("Enter")
    page.wait_for_selector("body.playing")
    page.keyboard.press(" ")
    one.until_over()


def test_second_tab_is_told_so_and_may_take_the_stick(tab):
    first, second = tab().page, tab().page
    second.wait_for_selector("#banner:has-text('Another tab has the stick')")
    second.keyboard.press("ArrowRight")
    assert second.locator("body.playing").count() == 0
    second.click("#banner button")
    first.wait_for_selector("#banner:has-text('Another tab has the stick')")
    second.wait_for_selector(READY)
    second.keyboard.press("Enter")
    second.wait_for_selector("body.playing")
    first.wait_for_selector("body.playing")  # it watches
    second.keyboard.press(" ")


def test_server_stopped_and_started(browser, tmp_path):
    with served(tmp_path / "tries") as server:
        one = Tab(browser, server)
        one.page.wait_for_load_state("networkidle")  # what is being fetched as the server stops fails
        one.page.keyboard.press("Enter")
        one.page.wait_for_selector("body.playing")
        server.end(signal.SIGINT)
        one.page.wait_for_selector("#banner:has-text('The server has stopped')")
        assert one.problems == []
    with served(tmp_path / "tries") as server:
        again = Tab(browser, server)
        again.page.click("#earlier summary")
        assert "interrupted: the server was stopped" in again.page.inner_text("#rows")
        one.context.close()
        again.context.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1280])
def test_page_fits_and_a_tool_finds_it_accessible(tab, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    one = tab(width=width, height=740, color_scheme=scheme, reduced_motion="reduce", bypass_csp=True)
    page = one.page
    page.wait_for_selector("#film .igw-panel")
    for begin in (False, True):
        if begin:
            page.keyboard.press("Enter")
            page.wait_for_selector("body.playing")
            page.keyboard.press(" ")
            one.until_over()
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found = axe.run(page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
    animations = page.evaluate("() => document.getAnimations().length")
    assert animations == 0


def test_client_that_reads_slowly_holds_nobody_up(server):
    slow = connect(server.address.replace("http", "ws") + "ws", origin=server.origin, compression=None, max_queue=1)
    with server.connect() as player, slow:
        heard(player, "role")
        player.send(json.dumps({"take": 1}))
        player.send(json.dumps({"begin": {"setup": "teleop-spring", "assist": "brake", "slow": 1.0, "seen": False}}))
        player.send(json.dumps({"done": 1}))
        assert heard(player, "ended")
