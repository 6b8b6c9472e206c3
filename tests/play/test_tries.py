"""Tries are files that the environment and `simulate` play again; variants of tries; the clock, with simulated time."""

import json
import math
import os
import resource

import numpy as np
import pytest
from play_client import SETUP, near_setup, pushed, wanted
from refusal import refused

from experiments.play import contest, tries, try_files
from experiments.play.assistance import NAMES, PERIOD
from experiments.play.clock import HOLD, SILENT, Clock, Stick


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
def test_same_hand_without_delay_with_the_brake_or_another_coupling_does_what_it_would_have_done(setup):
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


class Hand:
    """A clock in this process, whose time passes only while it sleeps, and its messages about the last try.

    `steer(hand, frame)` is called with each frame; `overslept(step)` is the time by which it sleeps too long, s.
    """

    def __init__(self, folder):
        self.folder, self.setup, self.time = folder / "tries", str(near_setup(folder)), 100.0
        self.clock = Clock(self, lambda: self.time, self.sleep)

    def sleep(self, seconds):
        self.time += seconds + self.overslept(round((self.time - 100.0) / PERIOD))

    def send(self, message):
        self.messages.append(message | {"at": self.time})
        if message["kind"] == "frame":
            self.steer(self, message)

    def play(self, steer, name="a", overslept=lambda step: 0.0, **asked):
        """Play a try that is kept in a file of that name; return the last message about it."""
        self.messages, self.steer, self.overslept, self.clock.stick = [], steer, overslept, Stick()
        self.clock.play(wanted(**{"setup": self.setup, **asked}), self.folder / f"{name}.json", False)
        self.frames = [message for message in self.messages if message["kind"] == "frame"]
        return self.messages[-1]

    def kept(self, name="a"):
        """Return a kept try, with times (s) and velocities (m/s) of its commands."""
        this = try_files.read(self.folder / f"{name}.json")
        return this, np.array(this.operator["time"]), np.array(this.operator["velocity"])


@pytest.fixture
def hand(tmp_path):
    return Hand(tmp_path)


def push(hand, frame, velocity=0.3):
    hand.clock.stick.touched |= frame["touched"]
    hand.clock.stick.put(0.0 if frame["touched"] else velocity, hand.time)


@pytest.mark.parametrize("slow", [1.0, 4.0])
def test_each_step_comes_when_it_is_due_and_slower_where_that_is_asked(hand, slow):
    entry = hand.play(push, slow=slow, assist="brake", jitter=0.01)["entry"]
    (this, *_), frames = hand.kept(), hand.frames
    assert (entry["name"], entry["marks"]) == ("a", [])
    assert entry.items() >= this.result.items()
    _, info, *_ = tries.replayed(this)  # looking ahead has changed nothing
    assert {name: info[name] for name in ("touch_time", "done_time", "taken")}.items() <= this.result.items()
    assert len(this.late) == len(this.actions) == len(frames) - 1 > 20
    assert np.abs(this.late).max() < 1e-9
    begun = np.array([frame["t"] for frame in frames])[:-1]  # a touch cuts a step short, and its frame is not sooner
    assert [frame["at"] - 100.0 for frame in frames[1:]] == pytest.approx(slow * (begun + PERIOD), abs=1e-4 * slow)
    waits = np.array([frame["wait"] / slow for frame in frames])
    assert waits.min() == pytest.approx(0.1, abs=5e-3)  # half of the delay there and back, and the jitter
    assert np.ptp(waits) > 0.01


def test_steps_that_come_late_are_noted_and_the_clock_goes_on_behind_a_machine_that_slept(hand):
    nap = {10: 0.005, 20: 1.0}  # s, by step
    hand.play(push, overslept=lambda step: nap.pop(step, 0.0))
    late = np.array(hand.kept()[0].late)
    assert late[[10, 11, 20]] == pytest.approx([0.005, -0.005, 1.0])  # a step that is late brings no other out of time
    assert np.abs(np.delete(late, [10, 11, 20])).max() < 1e-9
    assert np.diff([frame["at"] for frame in hand.frames])[21:40] == pytest.approx(PERIOD)  # nothing is made up for


def test_stick_that_is_silent_is_let_go(hand):
    def steer(hand, frame):
        if frame["n"] <= 5:
            hand.clock.stick.put(0.4, hand.time)

    assert hand.play(steer)["entry"]["missed"]
    _, time, velocity = hand.kept()
    assert {*velocity} == {0.0, 0.4}
    assert 5 * PERIOD + SILENT - PERIOD < time[velocity != 0.0].max() <= 5 * PERIOD + SILENT


def test_pause_before_a_touch_does_not_end_a_try_and_its_end_is_kept_unmarked(hand):
    def steer(hand, frame):
        hand.clock.stick.put(0.0, hand.time)
        if frame["t"] > 2.0:
            hand.clock.stick.stop()
            hand.clock.stick.stop("too late to mark it")

    assert hand.play(steer)["entry"]["marks"] == []
    _, time, velocity = hand.kept()
    assert {*velocity[(time > PERIOD) & (time < 2.0)]} == {HOLD}
    assert velocity[-1] == 0.0
    assert time[-1] < 3.0


def test_try_is_kept_until_a_full_disk_has_room(hand):
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)

    def steer(hand, frame):
        push(hand, frame, 0.1)
        if frame["n"] == 20:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1, unlimited[1]))

    try:
        failed = hand.play(steer)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert failed["kind"] == "failed"
    assert "no room to write" in failed["text"]
    assert "\n" not in failed["text"]
    assert [*hand.folder.iterdir()] == []
    assert [hand.play(push, name)["kind"] for name in "bc"] == ["ended", "ended"]
    assert sorted(each.name for each in hand.folder.iterdir()) == ["a.json", "b.json", "c.json"]
    assert [hand.kept(name)[0].marks for name in "abc"] == [[], [], []]
