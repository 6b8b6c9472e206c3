"""Whole attempts on simulated time: the clock that plays them, the stick, the pages of a session, and the files."""

import json
import math
from unittest import mock

import numpy as np
import pytest
from play_client import SETUP, Page, pushed
from refusal import refused

from experiments.play import attempts, contest
from experiments.play.assistance import NAMES, PERIOD
from experiments.play.clock import HOLD, SILENT, Stick
from impact_gym.teleop.operators import SIMPLE_REACTION


@pytest.mark.parametrize("slow", [1.0, 4.0])
def test_each_step_and_each_picture_comes_when_it_is_due(world, slow):
    page = Page(world)
    this = world.play(page, page.push, slow=slow, assist="brake", jitter=0.02)
    assert page.got("ended")[0]["entry"].items() >= this.result.items()
    assert attempts.replayed(this).info["done_time"] == this.result["done_time"]  # looking ahead has changed nothing
    frames, shown = [message for message in world.sent if message["kind"] == "frame"], page.got("frame")
    assert (len(this.actions) == len(frames) - 1 > 20, this.marks) == (True, [])
    begun = np.array([frame["t"] for frame in frames])[:-1]  # a touch cuts a step short, and its frame is not sooner
    assert [frame["at"] for frame in frames[1:]] == pytest.approx(slow * (begun + PERIOD), abs=1e-4 * slow)
    assert {frame["dt"] for frame in frames[:-1]} >= {slow * PERIOD}
    waits = np.array([frame["at"] - frames[frame["n"]]["at"] for frame in shown]) / slow
    assert waits.min() == pytest.approx(0.1, abs=5e-3)  # half of the delay there and back, and the jitter
    numbers = [frame["n"] for frame in shown]
    assert (numbers, len(numbers) < len(frames)) == (sorted({*numbers}), True)  # late and older pictures are not shown
    assert [message["kind"] for message in page.messages][-2:] == ["frame", "ended"]


def scripted(world, naps, pushes):
    """Play a try with pushes (share of full speed) and naps of the clock (s), both by their times (s)."""
    page, naps, begun = Page(world), dict(naps), world.now
    world.session.page = page
    for at, share in pushes.items():
        world.call_at(begun + at, lambda share=share: page.say(v=share))
    world.overslept = lambda: next((naps.pop(at) for at in [*naps] if world.now - begun >= at), 0.0)
    this = world.play(page, delay=0.0, jitter=0.0, distance=0.15)
    world.sleep(4.0)
    return this


AT_ONCE = {at: 0.6 if at < 0.9 else 0.0 for at in np.arange(0.001, 4.0, 0.05)}  # beyond the touch
LATER = {at: 0.6 if 1.0 < at < 1.9 else 0.0 for at in AT_ONCE}  # the same, a second later


@pytest.mark.parametrize(("naps", "pushes", "counts"), [
    ({0.1 * k: 0.015 for k in range(1, 20)}, AT_ONCE, True), ({0.3: 1.0}, AT_ONCE, False),
    ({0.2: 0.01605}, LATER, True), ({1.2: 0.03}, LATER, False),
])  # fmt: skip
def test_try_counts_where_exact_times_change_1_percent_at_most(world, naps, pushes, counts):
    """The truth is the same hand at a computer that is never late."""
    exact, this = scripted(world, {}, pushes).result, scripted(world, naps, pushes)
    near = [this.result[name] == pytest.approx(exact[name], rel=0.01) for name in ("slide", "done_time")]
    assert (exact["slide"] > 0.02, all(near), this.marks) == (True, counts, [] if counts else [attempts.BUSY])
    assert (this.result == exact) == (max(naps.values()) < PERIOD)  # late by less than a step: nothing changes
    at = [message["at"] for message in world.sent if message["kind"] == "frame"]
    assert (np.diff(at) < PERIOD - 0.016).sum() <= 1  # nothing is made up for; only the touch cuts a step short


def test_stick_gives_the_command_at_any_moment():
    stick = Stick([(-math.inf, 0.0), (1.0, 0.4), (1.1, 0.0), (1.2, 0.3), (2.0, 0.0), (2.1, 0.2)])
    expected = {0.9: 0.0, 1.0: 0.4, 1.099: 0.4, 1.1: HOLD, 1.2 + SILENT: 0.3, 1.21 + SILENT: 0.0, 2.05: HOLD}
    assert {moment: stick.at(moment) for moment in expected} == expected
    stick.touched_at = 2.0
    stick.stop(2.2)
    stick.stop(2.15, "too late to mark it")
    assert ([stick.at(moment) for moment in (1.15, 2.05, 2.1, 2.15)], stick.marks) == ([HOLD, 0.0, 0.2, 0.0], [])


def test_settings_and_pushes_reach_the_arm_until_a_silence(world):
    """A pause before the touch does not end a try; its end is kept unmarked."""
    page, (back, ahead) = Page(world), world.session.setups[str(world.setup)]["speeds"]
    shares = iter([0.5] * 10 + [-0.5] * 10)
    chosen = {"delay": 0.3, "jitter": 0.0, "stiffness": 70.0, "distance": 0.18}
    this = world.play(page, lambda frame: page.say(v=next(shares)) if frame["n"] < 20 else None, **chosen)
    expected = {"uplink.delay": 0.15, "downlink.delay": 0.15, "coupling.stiffness": 70.0, "distance": 0.18}
    assert {name: this.record[name] for name in expected} == pytest.approx(expected)
    assert {*this.operator["velocity"]} == {0.0, 0.5 * ahead, 0.5 * back}
    moved = [time for time, velocity in zip(this.operator["time"], this.operator["velocity"], strict=True) if velocity]
    assert (this.result["missed"], max(moved)) == (1.0, pytest.approx(19 * PERIOD + 0.15 + SILENT, abs=PERIOD))
    this = world.play(page, lambda frame: page.say(**({"done": 1} if frame["t"] > 2.0 else {"v": 0.0})), delay=0.0)
    assert (this.marks, this.operator["velocity"][-1]) == ([], 0.0)
    assert 2.0 < this.operator["time"][-1] < 3.0


def test_try_is_kept_until_a_full_disk_has_room(world):
    page = Page(world)
    with mock.patch.object(attempts, "write", side_effect=OSError("no room to write")):
        failed = world.play(page, page.push)
    assert (failed["kind"], failed["text"], world.session.busy) == ("failed", "no room to write", False)
    assert world.play(page, page.push).marks == []
    assert [this.marks for this in attempts.of_persons(world.folder)] == [[], []]


@pytest.mark.parametrize("why", ["another tab took the stick", "the page was closed"])
def test_newest_tab_has_the_stick_and_stops_the_others_try(world, why):
    first, others = Page(world), []

    def steer(frame):
        first.say(v=0.5)
        first.say(begin={})  # there is a try already
        if frame["n"] == 10:
            others.append(Page(world)) if "tab" in why else world.session.leave(first, why)

    this = world.play(first, steer)
    assert (this.marks, {*this.operator["velocity"]}) == ([f"interrupted: {why}"], {0.0, 0.25})
    assert len(first.got("taken")) == ("tab" in why)
    world.session.leave(first, "the page was closed")
    (second,) = others or [Page(world)]
    assert (world.session.page, world.play(second, second.push).marks) == (second, [])


def test_object_is_shown_where_seen_or_touched_or_at_the_end(world):
    page = Page(world)
    for seen, states in ((True, {(False, False), (True, False)}), (False, {(False, True), (True, False)})):
        page.messages.clear()
        world.play(page, page.push, seen=seen)
        assert {(frame["touched"], frame["to"][2] is None) for frame in page.got("frame")} == states
    world.play(page, lambda frame: page.say(done=1), distance=0.17)
    assert [page.got("frame")[-1][at][2] for at in ("from", "to")] == [0.17, 0.17]


@pytest.mark.parametrize("setup", ["teleop-rigid", SETUP, "teleop-bistable"])
@pytest.mark.parametrize("assist", NAMES)
def test_try_is_played_again_to_the_bit(setup, assist, tmp_path):
    rng = np.random.default_rng(0)
    done = pushed(lambda _: float(rng.uniform(0.1, 0.5)), 9, assist, 0, setup)
    this = attempts.read(attempts.write(tmp_path / "try.json", done))
    info = attempts.replayed(this).info
    assert {name: info["record"][name] for name in this.record} == this.record
    assert {name: info[name] for name in attempts.RESULTS} == this.result


DAMAGES = {
    "format": "impact_gym try 2", "slow": 0.0, "assist": "magic", "actions": [1.0], "result": {},
    "marks": ["</script>"], "setup": "</script>", "operator": {"type": "os:abort"}, "record": 10 ** 4000, "more": 1,
}  # fmt: skip


def test_file_that_is_no_try_is_refused_in_one_line(tmp_path):
    file = attempts.write(tmp_path / "a.json", pushed(lambda _: 0.5))
    made = json.loads(file.read_text())
    for text in ("", "{}", "[]", "\x00", *(json.dumps(made | {name: DAMAGES[name]}) for name in DAMAGES)):
        file.write_text(text)
        refused(lambda: attempts.read(file), "a.json cannot be read as a try")


def let_go(delay=0.2, assist="none", reaction=0.2):
    """Return the try of a hand that lets go `reaction` (s) after it sees the touch."""
    return pushed(lambda _: 0.3, math.ceil((0.5 * delay + reaction) / PERIOD), assist, delay=delay, jitter=0.0, seed=3)


def test_same_hand_in_each_variant_does_what_it_would_have_done():
    this = let_go()
    shown = contest.film(*contest.again(this))
    slides = shown["slides"]
    assert slides["You"] == pytest.approx(this.result["slide"], abs=1e-9)
    truth = let_go(delay=0.0).result["slide"]  # of the hand that really sees the touch at once
    assert slides["Your hand, no delay"] == pytest.approx(truth, abs=1e-3)
    assert slides["You"] - truth > 0.03
    assert slides["Your hand, brake on"] < 0.5 * slides["You"]
    assert "as fast as you did" in shown["words"]
    assisted = contest.film(*contest.again(let_go(assist="brake")))["slides"]
    assert assisted["Your hand, no help"] == pytest.approx(slides["You"], abs=1e-9)


@pytest.mark.parametrize("assist", ["brake", "limit"])
def test_key_still_down_at_the_end_is_let_go_in_the_films(assist):
    """As the same hand lets go that reacts in SIMPLE_REACTION, and that the brake does not relieve."""
    this = let_go(assist=assist, reaction=60.0)
    assert this.operator["velocity"][-1] == 0.3
    shown = contest.film(*contest.again(this))
    assert "Your try ended before you let go. In the other films, your hand lets go 0.21 s" in shown["words"]
    for name, truth in (
        ("no help", let_go(reaction=SIMPLE_REACTION)),
        ("letting go", let_go(0.2, assist, SIMPLE_REACTION)),
    ):
        assert shown["slides"][f"Your hand, {name}"] == pytest.approx(truth.result["slide"], abs=0.3 * PERIOD)
    pushing = contest.film(*contest.again(let_go(reaction=60.0)))["slides"]  # a hand alone really pushes on
    assert pushing["You"] > 1.0
    assert pushing["Your hand, no delay"] > 1.0


def test_film_of_a_missed_object_says_so():
    """The hand lets go too soon in each variant."""
    this = pushed(lambda time: 0.3 if time < 0.3 else 0.0, delay=0.2, jitter=0.0)
    assert {*contest.film(*contest.again(this))["slides"].values()} == {None}
