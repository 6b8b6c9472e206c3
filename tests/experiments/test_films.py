"""Shipped films are small, long enough to follow, and show what was simulated; all colours come from one palette."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from refusals import refused

import impact_gym as ig
from experiments import films
from experiments.films import FILMS, HAND, OBJECT, RATE, SECONDS, Films
from experiments.lab import colours
from impact_gym.render import palette

pytest.importorskip("pygame")
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", FILMS)
def test_shipped_film_is_small_and_lasts_six_to_ten_seconds_and_is_in_the_gallery(name):
    path = ROOT / films.SHIPPED / f"{name}.webp"
    rows = FILMS[name]
    assert path.stat().st_size < 600_000
    with Image.open(path) as film:
        lengths = []
        for place in range(film.n_frames):
            film.seek(place)
            film.load()
            lengths.append(film.info["duration"])
        assert film.size == (films.WIDTH, films.ROW * len(rows) + 8)
    assert 6.0 < sum(lengths) / 1e3 < 10.0
    assert len(lengths) > 100
    assert f"](films/{name}.webp)" in (ROOT / "docs" / "gallery.md").read_text()


def test_rows_leave_the_object_as_simulate_does_and_the_profile_is_as_soon_and_slower():
    rule, profile = (row.run().info for row in FILMS["rule-and-profile"])
    struck, contact = ig.Object(OBJECT["object_mass"], OBJECT["distance"]), ig.Contact(3.16e4, 0.55)
    scene = ig.Scene(ig.Tool(0.125), struck, contact, ig.SpringDamper(50.0))
    outcome = ig.simulate(scene, ig.Trapezoid(1.0, 8.0, ig.Brake(1.0, 0.016)), duration=1.0)
    assert rule["object_velocity"] == pytest.approx(outcome.object_velocity, abs=1e-6)
    assert profile["approach_time"] == pytest.approx(rule["approach_time"], abs=5e-3)
    assert profile["object_velocity"] < 0.5 * rule["object_velocity"]


def test_hand_acts_when_it_can_and_the_brake_acts_for_it():
    alone, brake = (row.run() for row in FILMS["hand-and-brake"])
    touch = alone.contacts[0][0]
    assert touch == brake.contacts[0][0]
    speed = alone.history.columns["command_velocity"]
    let_go = alone.history.time[np.flatnonzero(speed > 0.99 * speed.max())[-1]]
    late = HAND["uplink"]["delay"] + HAND["downlink"]["delay"] + 0.213  # s, and the hand's reaction time
    assert let_go - touch == pytest.approx(late, abs=0.02)  # a control step more or less
    assert brake.info["slide"] < 0.3 * alone.info["slide"]


@pytest.mark.parametrize("name", ["rule-and-profile", "hand-and-brake"])
def test_film_runs_forward_and_slower_while_they_touch(name):
    runs = [row.run() for row in FILMS[name]]
    times, slower = np.transpose([*films.instants(runs)])
    assert len(times) == round(SECONDS * RATE) + 1
    assert times[0] == 0.0
    assert (np.diff(times) > 0.0).all()
    first = min(run.contacts[0][0] for run in runs)
    assert slower[times < 0.5 * first].max() < slower[(times > first) & (times < first + 0.02)].min()


def test_film_shows_motion_and_result():
    first, *_, last = map(np.asarray, films.pictures(FILMS["rule-and-profile"][1:]))
    head = slice(films.HEAD)
    assert (first[films.HEAD :] != last[films.HEAD :]).any()
    assert (first[head, 600:] != last[head, 600:]).any()


def test_unknown_film_is_refused_before_any_is_written(tmp_path):
    refused(lambda: films.work(Films(("couplings", "no-such"), tmp_path)), "film", "no-such", "rule-and-profile")
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("scheme", [0, 1], ids=["light", "dark"])
def test_colours_of_text_can_be_read_on_page_and_panel(scheme):
    of = {}  # relative luminance (WCAG 2.2)
    for name, pair in palette.COLOURS.items():
        parts = np.array([*bytes.fromhex(pair[scheme].removeprefix("#"))]) / 255.0
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        of[name] = linear @ [0.2126, 0.7152, 0.0722]
    for name in ("rule", "policy", "profile", "person", "object", "force", "warning", "alarm", "muted", "fg", "link"):
        for ground in ("bg", "panel"):
            light, dark = sorted([of[name], of[ground]], reverse=True)
            assert (light + 0.05) / (dark + 0.05) >= 4.5, (name, ground)


def test_drawing_follows_the_page_in_the_colours_of_the_palette():
    drawing = f'<svg width="1"><path style="stroke: {palette.RULE.lower()}"/><path style="stroke: #123456"/></svg>'
    adaptive = colours.adaptive(drawing)
    assert f"stroke: var(--rule, {palette.RULE.lower()})" in adaptive
    assert "stroke: #123456" in adaptive
    dark = adaptive.split("prefers-color-scheme: dark")[1]
    assert f"--rule: {palette.COLOURS['rule'][1].lower()}" in dark
