"""The page in a real browser, for hours."""

import pytest
from playing import Tab, served


@pytest.mark.storm
def test_two_hundred_tries_in_a_row_without_growth_of_memory(browser, tmp_path):
    with served(tmp_path / "tries", "--assist", "brake") as server:
        one = Tab(browser, server)
        page, session = one.page, one.context.new_cdp_session(one.page)
        session.send("Performance.enable")

        def heap():
            session.send("HeapProfiler.collectGarbage")
            found = {each["name"]: each["value"] for each in session.send("Performance.getMetrics")["metrics"]}
            return found["JSHeapUsedSize"], found["Nodes"], server.memory()

        held = []
        for number in range(200):  # locators, as what `wait_for_selector` returns would hold what it found
            page.keyboard.press("Enter")
            page.locator("body.playing").wait_for()
            page.keyboard.press("ArrowRight")
            page.keyboard.press(" ")
            page.locator("body:not(.playing)").wait_for()
            if number % 20 == 19:
                page.locator("#film .igw-panel").first.wait_for()
                held.append(heap())
        assert len(server.tries()) == 200
        for first, last in zip(held[2], held[-1], strict=True):  # from 60 on; the chart still gets a dot for each
            assert last < 1.25 * first
        assert one.problems == []
