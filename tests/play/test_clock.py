"""The clock of tries, with its time handed in: when steps come, what is commanded, what is kept, without waiting."""

import resource
from itertools import pairwise

import numpy as np
import pytest
from playing import Hand, near_setup

from experiments.play import tries
from experiments.play.assistance import PERIOD
from experiments.play.clock import HOLD, SILENT
from experiments.play.tries import LATE
from impact_gym.operators import CUT


@pytest.fixture(scope="module")
def setup(tmp_path_factory):
    return str(near_setup(tmp_path_factory.mktemp("near") / "own"))


@pytest.fixture
def file(tmp_path):
    return tmp_path / "a.json"


def push(hand, frame, velocity=0.3):
    """Push until a touch is seen."""
    hand.clock.stick.touched |= frame["touched"]
    hand.clock.stick.put(0.0 if frame["touched"] else velocity, hand.time)


def commands(file):
    """Return times (s) and velocities (m/s) of what was commanded in a try that is kept."""
    operator = tries.read(file).operator
    return np.array(operator["time"]), np.array(operator["velocity"])


@pytest.mark.parametrize("slow", [1.0, 4.0])
def test_each_step_comes_when_it_is_due_and_slower_where_that_is_asked(setup, slow, file):
    hand = Hand(push)
    ended = hand.play(file, setup=setup, slow=slow, assist="brake", jitter=0.01)
    this, frames = tries.read(file), hand.frames
    assert (ended["kind"], ended["entry"]["name"], ended["entry"]["marks"]) == ("ended", "a", [])
    assert {*ended["entry"]["beside"]} == {"paper's rule"}  # nothing was trained for this set-up
    assert ended["entry"].items() >= this.result.items()
    assert len(this.late) == len(this.actions) == len(frames) - 1 > 20
    assert np.abs(this.late).max() < 1e-9
    begun = np.array([frame["t"] for frame in frames])[:-1]  # a touch cuts a step short, and its frame is not sooner
    assert [frame["at"] - 100.0 for frame in frames[1:]] == pytest.approx(slow * (begun + PERIOD), abs=1e-4 * slow)
    assert not file.with_suffix(".journal").exists()
    mean, waits = 0.01, np.array([frame["wait"] / slow for frame in frames])
    assert waits.min() == pytest.approx(0.1, abs=5e-3)  # half of the delay there and back, and the jitter
    assert waits.max() <= 0.1 + CUT * mean
    assert np.ptp(waits) > mean


def test_frames_say_what_comes_and_nothing_of_the_object_until_it_is_touched(setup, file):
    for seen in (False, True):
        hand = Hand(push)
        hand.play(file, seen=seen, setup=setup)
        before = [frame for frame in hand.frames if not frame["touched"]]
        assert all((frame["to"][2] is None) != seen for frame in before)
        assert None not in hand.frames[-1]["to"]
        for one, other in pairwise(before):
            assert one["to"][0] == pytest.approx(other["from"][0], abs=1e-9)
    hand = Hand()
    assert hand.play(file, setup=setup)["entry"]["missed"]  # of which the object is shown at last
    assert [frame["to"][2] is None for frame in hand.frames[-2:]] == [True, False]


def test_steps_that_come_late_are_noted_and_the_clock_goes_on_behind_a_machine_that_slept(setup, file):
    first = 100.0 + 10 * PERIOD
    nap = {10: 0.005, 20: 1.0}  # s, by step

    def overslept(time):
        return nap.pop(round((time - 100.0) / PERIOD), 0.0)

    hand = Hand(push, overslept)
    hand.play(file, setup=setup)
    late = np.array(tries.read(file).late)
    assert late[[10, 11, 20]] == pytest.approx([0.005, -0.005, 1.0])  # a step that is late brings no other out of time
    assert np.abs(np.delete(late, [10, 11, 20])).max() < 1e-9
    at = np.array([frame["at"] for frame in hand.frames])
    assert at[11] == pytest.approx(first + PERIOD + 0.005)
    assert at[12] == pytest.approx(first + 2 * PERIOD)
    assert np.diff(at)[21:40] == pytest.approx(PERIOD)  # nothing is made up for


@pytest.mark.parametrize(("every", "counts"), [(80, False), (120, True)])  # each makes the next one come too soon
def test_try_with_more_than_two_percent_of_late_steps_does_not_count(setup, file, every, counts):
    def overslept(time):
        return 1.1 * LATE if round((time - 100.0) / PERIOD) % every == 9 else 0.0

    hand = Hand(overslept=overslept)
    marks = hand.play(file, setup=setup)["entry"]["marks"]
    late = np.abs(tries.read(file).late) > LATE
    assert (np.mean(late) <= 0.02) == counts
    assert marks == ([] if counts else ["invalid: too many late steps"])


def test_stick_that_is_silent_is_let_go(setup, file):
    def steer(hand, frame):
        if frame["n"] <= 5:
            hand.clock.stick.put(0.4, hand.time)

    hand = Hand(steer)
    assert hand.play(file, setup=setup)["entry"]["missed"]
    time, velocity = commands(file)
    commanded = time[velocity != 0.0]
    assert {*velocity} == {0.0, 0.4}
    assert 5 * PERIOD + SILENT - PERIOD < commanded.max() <= 5 * PERIOD + SILENT
    assert np.ptp([frame["to"][0] for frame in hand.frames if frame["t"] > SILENT + 0.5]) == 0.0  # the arm rests


def test_pause_before_a_touch_does_not_end_a_try_and_its_end_is_kept_unmarked(setup, file):
    def steer(hand, frame):
        hand.clock.stick.put(0.0, hand.time)
        if frame["t"] > 2.0:
            hand.clock.stick.stop()
            hand.clock.stick.stop("interrupted: too late to mark it")

    hand = Hand(steer)
    assert hand.play(file, setup=setup)["entry"]["marks"] == []
    time, velocity = commands(file)
    assert {*velocity[(time > PERIOD) & (time < 2.0)]} == {HOLD}
    assert velocity[-1] == 0.0
    assert time[-1] < 3.0


def test_disk_that_is_full_stops_the_arm_and_the_try_is_kept_until_there_is_room(setup, file):
    unlimited = resource.getrlimit(resource.RLIMIT_FSIZE)

    def steer(hand, frame):
        push(hand, frame, 0.1)
        if frame["n"] == 20:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1, unlimited[1]))

    hand = Hand(steer)
    try:
        failed = hand.play(file, setup=setup)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    told = [message for message in hand.told if message["kind"] == "said"]
    for message in (*told, failed):
        assert "no room to write" in message["text"]
        assert "\n" not in message["text"]
    assert (len(told), failed["kind"], [each.suffix for each in file.parent.iterdir()]) == (1, "failed", [".journal"])
    hand.steer, second = push, file.with_name("b.json")
    assert hand.play(second, setup=setup)["kind"] == "ended"
    assert [tries.read(each).marks for each in (file, second)] == [["interrupted: no room for the journal"], []]
    time, velocity = commands(file)
    assert time[velocity > 0.0].max() <= 21 * PERIOD
    assert not file.with_suffix(".journal").exists()


def test_what_cannot_begin_is_said(file):
    failed = Hand().play(file, assist="magic")
    assert failed["kind"] == "failed"
    assert "assist must be one of none, brake, limit, policy, rule, got 'magic'" in failed["text"]
