"""The page in a real browser: from the first key to the replay, with every device, and when something goes wrong."""

import signal

import pytest
from browser_pages import opened
from play_client import READY, SETUP, begin, served, until_over

PAD = """() => {
  const pad = {axes: [0, 0], buttons: [{pressed: false}, {pressed: false}]};
  navigator.getGamepads = () => [pad];
  window.pad = pad;
}"""


@pytest.fixture
def tab(browser, server):
    """Open pages; at the end of the test none may have logged a message or called another server."""
    pages = []

    def open_tab(server=server, **options):
        own = (server.address, server.address.replace("http", "ws"), "data:")
        page, problems = opened(browser, server.address, own=own, **options)
        page.wait_for_selector(READY + ", body.watching")
        pages.append((page, problems))
        return page

    yield open_tab
    for page, problems in pages:
        page.context.close()
        assert problems == []


def test_try_from_the_first_key_to_the_replay_and_a_server_that_is_stopped_and_started(tab, tmp_path):
    with served(tmp_path / "tries", SETUP) as server:
        page = tab(server)
        page.keyboard.down("ArrowRight")
        page.wait_for_selector("body.playing")
        page.wait_for_selector("#picture circle.igw-object", state="visible")  # on the first level
        page.wait_for_selector("body.touching", timeout=9000)
        page.keyboard.up("ArrowRight")
        until_over(page)
        (this,) = server.tries(1)
        assert this.marks in ([], ["invalid: too many late steps"])
        assert this.record["uplink.delay"] == 0.0
        page.wait_for_selector("#film h3:has-text('Your hand, brake on')")
        assert f"done after {this.result['done_time']:.1f} s" in page.inner_text("#answer")
        page.click("#earlier summary")
        page.click("#rows button >> nth=0")
        page.wait_for_selector("#film .igw-panel")
        page.wait_for_load_state("networkidle")  # what is being fetched as the server stops fails
        begin(page)
        server.end(signal.SIGINT)
        page.wait_for_selector("#banner:has-text('The server has stopped')")
        page.context.close()
    with served(tmp_path / "tries", SETUP) as server:
        again = tab(server)
        again.click("#earlier summary")
        assert "interrupted: the server was stopped" in again.inner_text("#rows")
        again.context.close()


def test_levels_end_in_free_play_and_a_missed_try_says_so_and_is_no_step(tab, tmp_path):
    with served(tmp_path / "tries") as server:
        page = tab(server)
        for number, (name, delay, seen) in enumerate([("near", 0.0, True), ("far", 0.2, True), ("blind", 0.2, False)]):
            assert name in page.inner_text("#rounds [aria-pressed=true]")
            assert ("the picture lags on purpose" in page.inner_text("#task")) == (delay > 0.0)
            for missed in (True, False):
                begin(page)
                page.wait_for_timeout(300)
                assert page.locator("#picture circle.igw-object").is_visible() == seen
                if not missed:
                    page.keyboard.down("ArrowRight")
                    page.wait_for_selector("body.touching", timeout=9000)
                    page.keyboard.up("ArrowRight")
                page.keyboard.press(" ")
                until_over(page)
                if missed:
                    assert "You did not touch it" in page.inner_text("#answer")
            this = server.tries(2 * number + 2)[-1]
            assert this.record["uplink.delay"] == pytest.approx(0.5 * delay)
            if this.marks:
                pytest.skip("this machine is too busy to play in time")
        begin(page, "b")  # the last level again, though the page is at the next
        page.keyboard.press(" ")
        until_over(page)
        this = server.tries(7)[-1]
        assert (this.assist, this.record["uplink.delay"]) == ("brake", pytest.approx(0.1))
        assert "free play" in page.inner_text("#rounds [aria-pressed=true]")
        page.context.close()


@pytest.mark.parametrize("device", ["mouse", "touch", "gamepad"])  # of the keys tell the others
def test_every_device_steers(tab, server, device):
    before, page = len(server.tries()), tab(has_touch=device == "touch")
    box, touch = page.locator("#stick").bounding_box(), page.context.new_cdp_session(page)
    x, y = box["x"] + 0.55 * box["width"], box["y"] + 0.5 * box["height"]

    def push(share):
        if device == "touch":
            kind, points = ("touchStart", [{"x": x, "y": y}]) if share else ("touchEnd", [])
            touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        elif device == "gamepad":
            page.evaluate("(share) => { window.pad.axes[0] = share; }", share)
        elif share:
            page.mouse.move(box["x"] + box["width"] / 3, y)
            page.mouse.down()
            page.mouse.move(x, y, steps=4)
        else:
            page.mouse.up()

    page.evaluate(PAD)
    push(0.45)
    page.wait_for_selector("body.playing")
    page.wait_for_function("() => document.querySelector('#stick').getAttribute('aria-valuenow') > 20")
    page.wait_for_selector("body.touching", timeout=9000)
    push(0.0)
    until_over(page)
    assert page.get_attribute("#stick", "aria-valuenow") == "0"
    velocities = server.tries(before + 1)[-1].operator["velocity"]
    assert 0.1 < max(velocities) < 0.45
    assert velocities[-1] == 0.0


def test_reload_in_the_middle_keeps_the_try_and_the_page_goes_on(tab, server):
    before, page = len(server.tries()), tab()
    begin(page)
    page.reload()
    page.wait_for_selector(READY)
    assert server.tries(before + 1)[-1].marks[0] == "interrupted: the page was closed"
    page.wait_for_timeout(700)  # in which Enter could still be of the try before
    begin(page)
    page.keyboard.press(" ")
    until_over(page)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1280])
def test_page_fits_and_a_tool_finds_it_accessible(tab, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = tab(width=width, height=844, color_scheme=scheme, reduced_motion="reduce", bypass_csp=True)
    for played in (False, True):
        if played:
            page.keyboard.down("ArrowRight")
            page.wait_for_selector("body.touching", timeout=9000)
            page.keyboard.up("ArrowRight")
            until_over(page)
            page.wait_for_selector("#film .igw-panel")
            page.click("#choices summary")
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found = axe.run(page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
