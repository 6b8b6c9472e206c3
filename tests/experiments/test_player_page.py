"""The films run in a browser, from disk and with nothing else."""

import itertools

import browsers
import numpy as np
import pytest
from watched import CONTESTANTS, COUPLINGS, columns, judged_films

from experiments.lab.player import fragment, script, style


@pytest.fixture(scope="module", params=COUPLINGS)
def film(request):
    return judged_films(**COUPLINGS[request.param])


@pytest.fixture(scope="module")
def page_file(film, tmp_path_factory):
    path = tmp_path_factory.mktemp("watch") / "page.html"
    head = '<!doctype html><html lang="en"><meta charset="utf-8"><title>Watch</title>'
    head += '<meta name="viewport" content="width=device-width, initial-scale=1">'
    head += f"<style>{style()}</style>"
    path.write_text(f"{head}<body>{fragment(film[0])}<script>{script()}</script></body></html>")
    return path


def opened(browser, page_file, width=1280, motion="reduce"):
    page, problems = browsers.opened(browser, page_file, width, reduced_motion=motion)
    page.wait_for_selector(".igw-panel")  # a film is made when it is first seen
    return page, problems


def picture(page):
    return page.evaluate("[...document.querySelectorAll('.igw-panel svg')].map(svg => svg.outerHTML)")


def seek(page, film):
    page.evaluate("""film => { const slider = document.querySelector('.igw-slider');
                     slider.value = film; slider.dispatchEvent(new Event('input')); }""", film)  # fmt: skip


@pytest.mark.parametrize("width", [390, 1280])
def test_player_slider_and_choice_change_the_picture(browser, page_file, width):
    page, problems = opened(browser, page_file, width)
    steps = float(page.get_attribute(".igw-slider", "max"))
    pictures = []
    for share in (0.05, 0.5, 0.98):
        seek(page, share * steps)
        pictures.append(picture(page))
    page.select_option(".igw-select", "3")
    pictures.append(picture(page))
    assert all(len(panels) == 4 for panels in pictures)
    for pair in itertools.combinations(pictures, 2):
        assert all(a != b for a, b in zip(*pair, strict=True))
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert page.locator(".igw-panel h3").all_inner_texts() == list(CONTESTANTS)  # names are text
    assert page.locator(".igw-panel b").count() == 0
    tops = [chain.bounding_box()["y"] for chain in page.locator(".igw-chain").all()]
    assert (tops[0] == tops[1]) == (width > 600)
    assert problems == []


def in_film(scene, time):
    stretches = itertools.pairwise([*scene["clock"], [scene["end"], 0]])
    return sum((min(end, time) - start) * slower for (start, slower), (end, _) in stretches if start < time)


def test_player_positions_are_to_one_scale(browser, page_file, film):
    page, _ = opened(browser, page_file)
    scene = film[0]["scenes"][0]
    for time in (0.2 * scene["end"], scene["runs"][0]["contacts"][0][0], scene["end"]):
        seek(page, round(500 * in_film(scene, time) / in_film(scene, scene["end"])))
        places = page.evaluate("""[...document.querySelectorAll('.igw-chain')].map(svg => {
            const ball = svg.querySelector(':scope > circle.igw-object');
            const tool = svg.querySelector(':scope > rect.igw-tool'), of = (shape, name) => +shape.getAttribute(name);
            return [of(tool, 'x') + of(tool, 'width'), of(ball, 'cx') - of(ball, 'r')]; })""")
        instant = float(page.inner_text(".igw-time").split()[0]) / 1e3
        half_a_step = 0.5 * in_film(scene, scene["end"]) / 500
        assert in_film(scene, instant) == pytest.approx(in_film(scene, time), abs=half_a_step + 0.02)
        positions = []
        for run in map(columns, scene["runs"]):
            tool, ball = (np.interp(instant, run["time"], run[f"{name}_position"]) for name in ("tool", "object"))
            gone_on = max(instant - run["time"][-1], 0.0)
            positions.append([tool, ball + gone_on * run["object_velocity"][-1]])
        scale, shift = np.polyfit(np.ravel(positions), np.ravel(places), 1)
        assert 300.0 < scale < 3000.0
        np.testing.assert_allclose(np.ravel(places), scale * np.ravel(positions) + shift, atol=0.2)


def test_player_plays_pauses_and_takes_keys(browser, page_file):
    page, problems = opened(browser, page_file)
    poster = page.inner_text(".igw-time")
    page.wait_for_timeout(300)
    assert page.inner_text(".igw-time") == poster  # no motion unless asked for
    assert "in contact" in page.inner_text(".igw-live")
    page.focus(".igw-slider")
    page.keyboard.press("ArrowRight")
    assert page.inner_text(".igw-time") != poster
    page.keyboard.press("Home")
    assert page.inner_text(".igw-time") == "0.0 ms"
    assert page.inner_text(".igw-rate") == "1/8 speed"
    assert page.get_attribute(".igw-slider", "aria-valuetext") == "0.0 ms, 1/8 speed"
    page.click(".igw-play")
    page.wait_for_function("parseFloat(document.querySelector('.igw-time').textContent) > 5")
    assert page.inner_text(".igw-play") == "Pause"
    page.click(".igw-play")
    stopped = page.inner_text(".igw-time")
    page.wait_for_timeout(200)
    assert page.inner_text(".igw-time") == stopped
    page.evaluate("window.dispatchEvent(new Event('beforeprint'))")
    assert page.inner_text(".igw-time") == poster
    assert problems == []


def test_player_starts_where_motion_is_welcome_and_leaves_no_globals(browser, page_file, tmp_path):
    blank = tmp_path / "blank.html"
    blank.write_text("<!doctype html><title>Nothing</title>")
    page, problems = opened(browser, page_file, motion="no-preference")
    page.wait_for_function("document.querySelector('.igw-play').textContent === 'Pause'")
    names = page.evaluate("Object.getOwnPropertyNames(window)")
    page.goto(blank.as_uri())
    assert set(names) <= set(page.evaluate("Object.getOwnPropertyNames(window)"))
    assert problems == []
