"""Tries are files that the environment and `simulate` play again; variants of tries."""

import json
import math
import os

import numpy as np
import pytest
from play_client import SETUP, pushed
from refusal import refused

from experiments.play import contest, tries, try_files
from experiments.play.assistance import NAMES, PERIOD


@pytest.mark.parametrize("setup", ["teleop-rigid", SETUP, "teleop-bistable"])
@pytest.mark.parametrize("assist", NAMES)
def test_try_is_played_again_by_environment_and_simulate(setup, assist, tmp_path):
    """The environment to the bit; `simulate`, from the executed motion alone, to 1e-9, and itself to the bit."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        asked = {"assist": assist, "seed": seed, "setup": setup}
        done = pushed(lambda _, rng=rng: float(rng.uniform(0.1, 0.5)), 4 + 9 * seed, **asked)
        this = try_files.read(try_files.write(tmp_path / "try.json", done))
        _, info, *_ = tries.replayed(this)
        assert {name: info["record"][name] for name in this.record} == this.record
        assert {name: info[name] for name in ("touch_time", "done_time", "taken")}.items() <= this.result.items()
        outcome = tries.simulated(this)
        assert outcome.peak_object_velocity == this.result["object_velocity"]
        assert outcome.slide == this.result["slide"]
        assert outcome.peak_force == this.result["peak_force"]
        assert outcome.peak_object_velocity == pytest.approx(info["object_velocity"], abs=1e-9)
        assert outcome.slide == pytest.approx(info["slide"], abs=1e-9)
        assert outcome.peak_force == pytest.approx(info["peak_force"], abs=1e-9, rel=1e-9)


SCRIPT = "</script><script>alert(1)</script>"
DAMAGES = {
    "format": "impact_gym try 1", "slow": 0.0, "assist": "magic", "seed": "1", "actions": [1.0], "late": [math.nan],
    "marks": [SCRIPT], "setup": SCRIPT, "operator": {"type": "os:abort"}, "made": SCRIPT, "result": {},
    "result.done_time": 1e300, "result.slide": math.inf, "result.missed": "no", "record.uplink.delay": None,
    "environment": [], "motion": {"times": [10**400]}, "record": 10 ** 4000, "more": 1,
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return json.loads(try_files.write(tmp_path_factory.mktemp("made") / "a.json", pushed(lambda _: 0.5)).read_text())


@pytest.mark.parametrize("name", ["", "no", "list", "\x00", *DAMAGES])
def test_file_that_is_no_try_is_refused_in_one_line(name, made, tmp_path):
    part, _, inner = name.partition(".")
    value = {**made.get(part, {}), inner: DAMAGES[name]} if inner else DAMAGES.get(name)
    text = json.dumps({**made, part: value}) if name in DAMAGES else {"no": "{}", "list": "[]"}.get(name, name)
    (tmp_path / "a.json").write_text(text)
    refused(lambda: try_files.read(tmp_path / "a.json"), "a.json cannot be read as a try")


def test_file_that_would_not_end_is_refused(tmp_path):
    os.mkfifo(tmp_path / "a.json")
    (tmp_path / "b.json").symlink_to("/dev/zero")
    with (tmp_path / "c.json").open("wb") as sparse:
        sparse.truncate(1 << 30)
    for name, says in (("a", "no regular file"), ("b", "no regular file"), ("c", "at most 100,000,000 bytes")):
        refused(lambda name=name: try_files.read(tmp_path / f"{name}.json"), says)


def let_go(setup=SETUP, delay=0.2, **asked):
    """Return the try of a hand that lets go 0.2 s after it sees the touch."""
    after = math.ceil((0.5 * delay + 0.2) / PERIOD)
    return pushed(lambda _: 0.3, after, setup=setup, seed=3, delay=delay, jitter=0.0, **asked)


@pytest.mark.parametrize("setup", ["teleop-rigid", SETUP])
def test_same_hand_in_each_variant_does_what_it_would_have_done(setup):
    this = let_go(setup)
    again = contest.again(this)
    slides = contest.film(again)["slides"]
    assert slides["You"] == pytest.approx(this.result["slide"], abs=1e-9)
    for name, variant in again.items():
        if "no delay" not in name:
            assert variant.played.operator == this.operator  # the same commands
    for name in ("object_mass", "contact_stiffness", "restitution", "distance", "friction"):
        assert {variant.played.record[name] for variant in again.values()} == {this.record[name]}
    truth = let_go(setup, delay=0.0).result["slide"]  # of the hand that really sees the touch at once
    assert slides["Your hand, no delay"] == pytest.approx(truth, abs=1e-3)
    assert slides["You"] - truth > 0.03
    assert slides["Your hand, brake on"] < 0.5 * slides["You"]
    assisted = contest.again(let_go(setup, assist="brake"))
    assert "Your hand, no help" in assisted
    assert contest.film(assisted)["slides"]["Your hand, no help"] == pytest.approx(slides["You"], abs=1e-9)
