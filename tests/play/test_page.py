"""The page in a real browser: from the first key to the replay, with every device, and when something goes wrong."""

import signal

import pytest
from playing import READY, SETUP, begin, open_page, served, until_over

PAD = """() => {
  const pad = {axes: [0, 0], buttons: [{pressed: false}, {pressed: false}]};
  navigator.getGamepads = () => [pad];
  window.pad = pad;
}"""


@pytest.fixture
def tab(browser, server):
    """Open a page that must complain of nothing and ask nothing of others, until the test is over."""
    opened = []

    def open_tab(server=server, **options):
        opened.append(open_page(browser, server, **options))
        return opened[-1][0]

    yield open_tab
    for page, problems in opened:
        page.context.close()
        assert problems == []


def test_try_from_the_first_key_to_the_replay_and_a_server_that_is_stopped_and_started(tab, tmp_path):
    with served(tmp_path / "tries", SETUP) as server:
        page = tab(server)
        page.wait_for_selector("#film .igw-panel")
        assert page.locator("#film h3").all_inner_texts() == ["paper's rule", "learned policy", "person (scripted)"]
        assert page.locator("#setup option").count() == 3
        stick = page.locator("#stick").bounding_box()
        page.evaluate("document.querySelector('#film').replaceChildren()")
        assert page.locator("#stick").bounding_box() == stick  # so that a film that comes moves it from under no finger
        page.keyboard.down("ArrowRight")
        page.wait_for_selector("body.playing")
        assert page.locator("#picture circle.igw-object").is_hidden()
        page.wait_for_selector("body.touching", timeout=9000)
        assert page.locator("#picture circle.igw-object").is_visible()
        page.keyboard.up("ArrowRight")
        until_over(page)
        (this,) = server.tries(1)
        assert this.marks in ([], ["invalid: too many late steps"])
        said = page.inner_text("#answer")
        assert f"{this.result['done_time']:.2f} s" in said
        assert page.locator("#film h3").all_inner_texts() == ["paper's rule", "learned policy", "you"]
        assert "you" in page.locator("#chart").text_content() or this.marks
        assert "In the same scene" in said
        page.click("#earlier summary")
        page.click("#rows button >> nth=0")
        page.wait_for_selector("#film .igw-panel")
        page.wait_for_load_state("networkidle")  # what is being fetched as the server stops fails
        page.focus("#stick")
        begin(page)
        server.end(signal.SIGINT)
        page.wait_for_selector("#banner:has-text('The server has stopped')")
        page.context.close()
    with served(tmp_path / "tries", SETUP) as server:
        again = tab(server)
        again.click("#earlier summary")
        assert "interrupted: the server was stopped" in again.inner_text("#rows")
        again.context.close()


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
    assert int(page.get_attribute("#stick", "aria-valuenow")) < 90
    page.wait_for_selector("body.touching", timeout=9000)
    push(0.0)
    until_over(page)
    assert page.get_attribute("#stick", "aria-valuenow") == "0"
    velocities = server.tries(before + 1)[-1].operator["velocity"]
    assert 0.1 < max(velocities) < 0.45
    assert velocities[-1] == 0.0


def test_keyboard_alone_chooses_begins_and_ends(tab, server):
    before, page = len(server.tries()), tab()
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
    begin(page)
    page.keyboard.down("ArrowRight")
    page.wait_for_timeout(300)
    page.keyboard.up("ArrowRight")
    page.wait_for_timeout(400)
    assert page.locator("body.playing").count() == 1  # a pause does not end it
    page.keyboard.press(" ")
    page.wait_for_selector("body:not(.playing)")
    this = server.tries(before + 1)[-1]
    assert this.assist == "brake"
    assert this.record["uplink.delay"] == this.record["downlink.delay"] == pytest.approx(0.125)
    assert max(this.operator["velocity"]) == pytest.approx(0.4 * 0.5)
    for key in ("→", "←", "↑", "↓", "Enter", "Space"):
        assert key in page.inner_text("#keys")


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


def test_second_tab_is_told_so_and_may_take_the_stick(tab):
    first, second = tab(), tab()
    second.wait_for_selector("#banner:has-text('Another tab has the stick')")
    second.keyboard.press("ArrowRight")
    assert second.locator("body.playing").count() == 0
    second.click("#banner button")
    first.wait_for_selector("#banner:has-text('Another tab has the stick')")
    second.wait_for_selector(READY)
    begin(second)
    first.wait_for_selector("body.playing")  # it watches
    second.keyboard.press(" ")


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [360, 1280])
def test_page_fits_and_a_tool_finds_it_accessible(tab, width, scheme):
    axe = pytest.importorskip("axe_playwright_python.sync_playwright").Axe()
    page = tab(width=width, height=740, color_scheme=scheme, reduced_motion="reduce", bypass_csp=True)
    page.locator("#film h2").scroll_into_view_if_needed()  # what nobody sees is not drawn
    page.wait_for_selector("#film .igw-panel")
    for played in (False, True):
        if played:
            begin(page)
            page.keyboard.press(" ")
            until_over(page)
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        found = axe.run(page).response["violations"]
        assert [(each["id"], [node["target"] for node in each["nodes"]]) for each in found] == []
    assert page.evaluate("() => document.getAnimations().length") == 0


@pytest.mark.storm
def test_two_hundred_tries_in_a_row_without_growth_of_memory(tab, server):
    before, page, held = len(server.tries()), tab(), []
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable")
    for number in range(200):  # locators, as what `wait_for_selector` returns would hold what it found
        page.keyboard.press("Enter")
        page.locator("body.playing").wait_for()
        page.keyboard.press("ArrowRight")
        page.keyboard.press(" ")
        page.locator("body:not(.playing)").wait_for()
        if number % 20 == 19:
            page.locator("#film .igw-panel").first.wait_for()
            session.send("HeapProfiler.collectGarbage")
            found = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
            held.append((found["JSHeapUsedSize"], found["Nodes"], server.memory()))
    assert len(server.tries()) == before + 200
    for first, last in zip(held[2], held[-1], strict=True):  # from 60 on; the chart still gets a dot for each
        assert last < 1.25 * first
