"""A try is a file that the environment and `simulate` play again, whatever ended it."""

import resource

import numpy as np
import pytest
from playing import choices, heard, lateness, play, say, served

from agents.setups import load_setup
from experiments.play import tries
from experiments.play.assistance import NAMES, usual
from experiments.play.live import Asked, Live, recovered

SETUPS = ("teleop-rigid", "teleop-spring", "teleop-bistable")


def pushed(live, seed):
    """Push with changing speed until a while after the touch, then let go; return the try."""
    rng, let_go = np.random.default_rng(seed), False
    while not live.ended:
        let_go |= bool(live.batch.bodies().touched[0]) and rng.random() < 0.06
        live.step(0.0 if let_go else float(rng.uniform(0.1, 0.5)))
    return live.finished()


@pytest.mark.parametrize("setup", SETUPS)
@pytest.mark.parametrize("assist", NAMES)
def test_try_is_played_again_by_environment_and_simulate(setup, assist, tmp_path):
    """The environment to the bit; `simulate`, from the executed motion alone, to 1e-9, and itself to the bit."""
    for seed in range(3):
        live = Live(Asked(setup, assist, usual(load_setup(setup)), seed))
        this = tries.read(tries.write(tmp_path / "try.json", pushed(live, seed)))
        _, info, _ = tries.replayed(this)
        for name, value in live.batch.info(0).items():
            assert info[name] == value, name
        outcome = tries.simulated(this)
        assert outcome.peak_object_velocity == this.result["object_velocity"]
        assert outcome.slide == this.result["slide"]
        assert outcome.peak_force == this.result["peak_force"]
        assert outcome.peak_object_velocity == pytest.approx(info["object_velocity"], abs=1e-9)
        assert outcome.slide == pytest.approx(info["slide"], abs=1e-9)
        assert outcome.peak_force == pytest.approx(info["peak_force"], abs=1e-9, rel=1e-9)


def test_what_is_ahead_comes_and_looking_changes_nothing():
    first, second = (Live(Asked("teleop-spring", "brake", usual(load_setup("teleop-spring")), 4)) for _ in range(2))
    while not first.ended:
        ahead = first.ahead()
        for live in (first, second):
            live.step(0.3)
        if first.time < ahead.time[0] + 1e-9 and not first.batch.bodies().touched[0]:
            assert np.array_equal([*first.batch.bodies()], [*ahead])  # a command of this step arrives later
    assert first.finished().result == second.finished().result


def test_journal_of_a_killed_process_becomes_a_try_that_is_marked(tmp_path):
    journal, asked = tmp_path / "a.journal", Asked("teleop-spring", "limit", usual(load_setup("teleop-spring")), 7)
    live = Live(asked, journal)
    for _ in range(50):
        live.step(0.4)
    live.close()
    cut = journal.read_text()[:-9]  # the last line not whole
    (tmp_path / "cut.journal").write_text(cut)
    this = recovered(tmp_path / "cut.journal")
    assert this.marks == ["interrupted: the server was killed"]
    assert not this.counts
    assert this.operator["velocity"][1:50] == [0.4] * 49
    assert {*this.operator["velocity"][50:]} == {0.0}
    assert this.actions[:49] == live.actions[:49]
    assert tries.simulated(this).slide == this.result["slide"]


def test_files_that_are_no_tries_are_refused_in_one_line(tmp_path):
    for text in ("", "{}", "[]", '{"format": "impact_gym try 0"}', '{"format": "impact_gym try 1", "slow": 1}', "\x00"):
        (tmp_path / "a.json").write_text(text)
        with pytest.raises(ValueError, match=r"a\.json is not read as a try") as refusal:
            tries.read(tmp_path / "a.json")
        assert "\n" not in str(refusal.value)


def test_late_steps_make_a_try_invalid_and_few_do_not():
    live = Live(Asked("teleop-spring", "none", usual(load_setup("teleop-spring")), 2))
    while not live.ended:
        live.step(0.4, late=5e-3 if len(live.actions) % 40 == 0 else 1e-3)
    assert live.finished().marks == ["invalid: too many late steps"]  # 2.5 %
    live.late = [late if k % 80 else 5e-3 for k, late in enumerate([1e-3] * len(live.late))]
    live.marks.clear()
    assert live.finished().counts


def test_disk_that_is_full_stops_the_arm_and_the_try_is_kept_until_there_is_room(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        assert play(page)["kind"] == "ended"
        say(page, begin=choices())
        heard(page, "began")  # a frame could be the last one's, on its way
        heard(page, "frame")
        resource.prlimit(server.clock, resource.RLIMIT_FSIZE, (1, resource.RLIM_INFINITY))
        said = heard(page, "said")
        assert "no room to write" in said["text"]
        assert "\n" not in said["text"]
        assert "no room to write" in heard(page, "failed")["text"]
        assert len(server.tries()) == 1
        assert server.process.poll() is None
        resource.prlimit(server.clock, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        assert play(page)["kind"] == "ended"
        assert [this.marks for this in server.tries()] == [[], ["interrupted: no room for the journal"], []]


def test_clock_notes_each_step_and_plays_slower_where_that_is_asked(tmp_path):
    with served(tmp_path / "tries") as server, server.connect() as page:
        play(page, slow=2.0, assist="brake")
        (this,) = server.tries()
        assert this.slow == 2.0
        assert len(this.late) == len(this.ages) == len(this.actions) > 20
        assert len(this.operator["velocity"]) in (len(this.actions), len(this.actions) + 1)
        assert np.isfinite(lateness([this])).all()
        assert min(this.ages) >= 0.0
