"""Whole tries on simulated time: the clock that plays them, the stick, and the pages of a session."""

import os
import resource
import signal
from types import SimpleNamespace

import numpy as np
import pytest
from play_client import Page, wanted

from experiments.play import clock, tries, try_files
from experiments.play.assistance import PERIOD
from experiments.play.clock import HOLD, SILENT


def given(this):
    """Times (s) and velocities (m/s) of a person's commands."""
    return np.array(this.operator["time"]), np.array(this.operator["velocity"])


@pytest.mark.parametrize("slow", [1.0, 4.0])
def test_each_step_and_each_picture_comes_when_it_is_due(world, slow):
    page, before = Page(world), world.now
    this = world.play(page, page.push, slow=slow, assist="brake", jitter=0.02)
    assert page.got("ended")[0]["entry"].items() >= this.result.items()
    assert this.marks == []
    _, info, *_ = tries.replayed(this)  # looking ahead has changed nothing
    assert {name: info[name] for name in ("touch_time", "done_time", "taken")}.items() <= this.result.items()
    frames = [message for message in world.sent if message["kind"] == "frame"]
    assert len(this.late) == len(this.actions) == len(frames) - 1 > 20
    assert np.abs(this.late).max() < 1e-9
    begun = np.array([frame["t"] for frame in frames])[:-1]  # a touch cuts a step short, and its frame is not sooner
    assert [frame["at"] - before for frame in frames[1:]] == pytest.approx(slow * (begun + PERIOD), abs=1e-4 * slow)
    assert {frame["dt"] for frame in frames[:-1]} >= {slow * PERIOD}
    sent = {frame["n"]: frame["at"] for frame in frames}
    waits = np.array([frame["at"] - sent[frame["n"]] for frame in page.got("frame")]) / slow
    assert waits.min() == pytest.approx(0.1, abs=5e-3)  # half of the delay there and back, and the jitter
    assert np.ptp(waits) > 0.01
    shown = [frame["n"] for frame in page.got("frame")]
    assert shown == sorted({*shown})  # a picture that comes late is not shown after a newer one
    assert len(shown) < len(frames)
    assert [message["kind"] for message in page.messages][-2:] == ["frame", "ended"]


def scripted(world, page, overslept, pushes):
    """Play a try with pushes, (s, share of full speed), at times that no picture changes."""
    naps = dict(overslept)

    def nap():
        return next((naps.pop(at) for at in [*naps] if world.now - begun >= at), 0.0)

    begun = world.now
    for at, share in pushes:
        world.call_at(begun + at, lambda share=share: page.say(v=share) if world.session.busy else None)
    world.overslept = nap
    this = world.play(page, delay=0.0, jitter=0.0, distance=0.15)
    world.overslept = lambda: 0.0
    world.sleep(4.0)
    return this


BEATS = np.arange(0.001, 4.0, 0.05)
LATE = [(at, 0.6 if at < 0.9 else 0.0) for at in BEATS]  # pushes on for a while after the touch
WAITS = [(at, 0.6 if 1.0 < at < 1.9 else 0.0) for at in BEATS]  # the same, a second later


@pytest.mark.parametrize(("naps", "pushes", "counts"), [
    ({0.1 * k: 0.015 for k in range(1, 20)}, LATE, True), ({0.3: 1.0}, LATE, False), ({0.5: 0.05}, LATE, False),
    ({0.2: 0.01605}, WAITS, True), ({0.2: 0.2}, WAITS, False), ({1.2: 0.03}, WAITS, False),
])  # fmt: skip
def test_try_counts_where_exact_times_change_1_percent_at_most(world, naps, pushes, counts):
    """The truth is the same hand at a computer that is never late."""
    page = Page(world)
    exact, this = scripted(world, page, {}, pushes).result, scripted(world, page, naps, pushes)
    assert exact["slide"] > 0.02
    near = [this.result[name] == pytest.approx(exact[name], rel=0.01) for name in ("slide", "done_time")]
        min(naps.values()) < PERIOD
    )
    assert all(near) == counts
    assert this.marks == ([] if counts else ["this computer was too busy; the try was not timed right: close other "
                                             "programs"])  # fmt: skip
    if min(naps.values()) < PERIOD:
        assert this.result == exact
        assert {*np.round(this.late, 3)} >= {0.0, 0.015, -0.015}


def test_machine_that_slept_makes_nothing_up(world):
    page, naps = Page(world), iter([0.0] * 20 + [1.0] + [0.0] * 10**4)
    world.overslept = lambda: next(naps)
    this = world.play(page, page.push)
    assert max(this.late) == pytest.approx(1.0)
    at = [message["at"] for message in world.sent if message["kind"] == "frame"]
    assert np.diff(at)[21:40] == pytest.approx(PERIOD)


def test_stick_that_is_silent_is_let_go(world):
    page = Page(world)
    this = world.play(page, lambda frame: page.say(v=0.4) if frame["n"] <= 5 else None, delay=0.0)
    time, velocity = given(this)
    assert (this.result["missed"], {*velocity}) == (1.0, {0.0, 0.2})  # 0.4 of 0.5 m/s
    assert 5 * PERIOD + SILENT - PERIOD < time[velocity != 0.0].max() <= 5 * PERIOD + SILENT


def test_pause_before_a_touch_does_not_end_a_try(world):
    """Its end is kept unmarked."""
    page = Page(world)

    def steer(frame):
        page.say(v=0.0)
        if frame["t"] > 2.0:
            page.say(done=1)
            world.clock.stick.stop(world.now, "too late to mark it")

    this = world.play(page, steer, delay=0.0)
    time, velocity = given(this)
    assert (this.marks, velocity[-1], time[-1] < 3.0) == ([], 0.0, True)
    assert {*velocity[(time > PERIOD) & (time < 2.0)]} == {HOLD}


def test_shares_are_of_the_arm_s_speeds_and_0_is_0_after_the_touch_is_seen(world):
    page, (back, ahead) = Page(world), world.session.setups[str(world.setup)]["speeds"]
    pushes = iter([0.5] * 10 + [-0.5] * 10 + [0.5] * 1000)
    this = world.play(page, lambda frame: page.say(v=0.0 if frame["touched"] else next(pushes)), delay=0.0)
    assert {*given(this)[1]} == {0.0, 0.5 * ahead, 0.5 * back}
    assert this.marks == []


def test_try_is_kept_until_a_full_disk_has_room(world):
    page, unlimited = Page(world), resource.getrlimit(resource.RLIMIT_FSIZE)

    def steer(frame):
        page.push(frame, 0.1)
        if frame["n"] == 20:
            resource.setrlimit(resource.RLIMIT_FSIZE, (1, unlimited[1]))

    try:
        failed = world.play(page, steer)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    assert (failed["kind"], world.session.busy) == ("failed", False)
    assert "no room to write" in failed["text"]
    assert "\n" not in failed["text"]
    assert [*world.folder.glob("*.json")] == []
    assert [world.play(page, page.push).marks for _ in range(2)] == [[], []]
    assert [this.marks for _, this in try_files.folder_of(world.folder)] == [[], [], []]


def test_second_tab_watches_and_may_take_the_stick(world):
    first, second, third = Page(world), Page(world), Page(world)
    roles = [[(role["player"], role["others"]) for role in page.got("role")] for page in (first, second, third)]
    assert roles == [[(True, 0), (True, 1), (True, 2)], [(False, 1), (False, 2)], [(False, 2)]]

    def steer(frame):
        first.say(v=0.5)
        second.say(v=1.0)  # who watches has no stick
        if frame["n"] == 10:
            second.say(take=1)

    this = world.play(first, steer)
    assert (this.marks, {*given(this)[1]}) == (["interrupted: another tab took the stick"], {0.0, 0.25})
    assert [page.got("role")[-1]["player"] for page in (first, second, third)] == [False, True, False]
    assert second.got("frame")[0]["to"][2] is None  # nobody is told where the object is
    assert second.got("ended")[0]["entry"]["marks"] == this.marks
    first.steer = lambda frame: None
    assert world.play(second, second.push).marks == []
    world.session.leave(second, "")
    assert first.got("role")[-1]["player"]


def test_object_is_shown_where_seen_or_touched_or_at_the_end(world):
    page = Page(world)
    world.play(page, page.push, seen=True)
    assert None not in [frame["to"][2] for frame in page.got("frame")]
    page.messages.clear()
    this = world.play(page, page.push)
    shown = [(frame["touched"], frame["to"][2] is not None) for frame in page.got("frame")]
    assert {*shown} == {(False, False), (True, True)}
    assert page.got("began")[0]["radius"] > 0.0
    page.messages.clear()
    world.play(page, lambda frame: page.say(done=1), distance=0.17)
    last = page.got("frame")[-1]
    assert (last["touched"], last["from"][2], last["to"][2]) == (False, 0.17, 0.17)
    assert this.result["touch_time"] > 0.0


def test_page_that_leaves_stops_the_arm_and_the_try_is_kept(world):
    page = Page(world)

    def steer(frame):
        page.push(frame)
        if frame["n"] == 9:
            world.session.leave(page, "the page was closed")

    this = world.play(page, steer)
    assert this.marks == ["interrupted: the page was closed"]
    assert given(this)[1][-1] == 0.0


def test_setting_reaches_the_episode(world):
    page = Page(world)
    record = world.play(page, delay=0.3, jitter=0.01, stiffness=70.0, distance=0.12).record
    for name, value in {"uplink.delay": 0.15, "downlink.delay": 0.15, "uplink.jitter": 0.01, "downlink.jitter": 0.01,
                        "coupling.stiffness": 70.0, "distance": 0.12}.items():  # fmt: skip
        assert record[name] == pytest.approx(value), name


def test_clock_goes_on_without_a_server_or_real_time_priority(tmp_path, monkeypatch):
    """In real time: the server is gone as the try begins."""
    asked, words = [], [("play", (wanted(), tmp_path / "a.json", False))]

    def refuse(*priority):
        asked.append(priority)
        raise PermissionError

    def recv():
        if words:
            return words.pop()
        raise EOFError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    monkeypatch.setattr(signal, "signal", lambda *how: None)
    end = SimpleNamespace(recv=recv, send=lambda message: None, close=lambda: None)
    clock.run(end, end)
    assert len(asked) == 1
    assert try_files.read(tmp_path / "a.json").marks == ["interrupted: the server was stopped"]
