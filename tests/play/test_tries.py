"""A try is a file that the environment and `simulate` play again, whatever ended it; and what it is compared with."""

import json

import numpy as np
import pytest
from playing import SETUP, pushed, wanted

from experiments.play import contest, tries
from experiments.play.assistance import NAMES
from experiments.play.live import Live, recovered


@pytest.mark.parametrize("setup", ["teleop-rigid", SETUP, "teleop-bistable"])
@pytest.mark.parametrize("assist", NAMES)
def test_try_is_played_again_by_environment_and_simulate(setup, assist, tmp_path):
    """The environment to the bit; `simulate`, from the executed motion alone, to 1e-9, and itself to the bit."""
    for seed in range(3):
        rng = np.random.default_rng(seed)
        done = pushed(
            lambda _, rng=rng: float(rng.uniform(0.1, 0.5)), 4 + 9 * seed, assist=assist, seed=seed, setup=setup
        )
        this = tries.read(tries.write(tmp_path / "try.json", done))
        _, info, _ = tries.replayed(this)
        assert {name: info["record"][name] for name in this.record} == this.record
        assert {name: info[name] for name in ("touch_time", "done_time", "taken")}.items() <= this.result.items()
        outcome = tries.simulated(this)
        assert outcome.peak_object_velocity == this.result["object_velocity"]
        assert outcome.slide == this.result["slide"]
        assert outcome.peak_force == this.result["peak_force"]
        assert outcome.peak_object_velocity == pytest.approx(info["object_velocity"], abs=1e-9)
        assert outcome.slide == pytest.approx(info["slide"], abs=1e-9)
        assert outcome.peak_force == pytest.approx(info["peak_force"], abs=1e-9, rel=1e-9)


def test_live_try_ends_as_its_replay_and_looking_ahead_changes_nothing():
    first, second = (Live(wanted("brake", 4)) for _ in range(2))
    while not first.ended:
        ahead = first.ahead()
        for live in (first, second):
            live.step(0.3)
        if first.time < ahead.time[0] + 1e-9 and not first.batch.bodies().touched[0]:
            assert np.array_equal([*first.batch.bodies()], [*ahead])  # a command of this step arrives later
    this = first.finished()
    assert this.result == second.finished().result
    _, info, _ = tries.replayed(this)
    for name, value in first.batch.info(0).items():
        assert info[name] == value, name


def test_journal_of_a_killed_process_becomes_a_try_that_is_marked(tmp_path):
    journal = tmp_path / "a.journal"
    live = Live(wanted("limit", 7), journal)
    for _ in range(50):
        live.step(0.4)
    live.close()
    journal.write_text(journal.read_text()[:-3])  # the last line not whole
    this = recovered(journal)
    assert this.marks == ["interrupted: the server was killed"]
    assert this.operator["velocity"][1:50] == [0.4] * 49
    assert {*this.operator["velocity"][50:]} == {0.0}
    assert this.actions[:49] == live.kept.actions[:49]
    assert tries.simulated(this).slide == this.result["slide"]


def test_files_that_are_no_tries_are_refused_in_one_line(tmp_path):
    file = tmp_path / "a.json"
    for text in (
        "",
        "{}",
        "[]",
        '{"format": "impact_gym try 1"}',
        f'{{"format": "{tries.FORMAT}", "slow": 1}}',
        "\x00",
    ):
        file.write_text(text)
        with pytest.raises(ValueError, match=r"^.*a\.json is not read as a try.*$"):  # one line
            tries.read(file)


def test_rule_and_policy_play_the_scene_of_a_try_and_the_first_film_lasts_ten_seconds():
    this = pushed(lambda _: 0.3, assist="brake", seed=3, delay=0.4, stiffness=200.0)
    rivals = contest.rivals_of(this)
    assert {name: rival.assist for name, rival in rivals.items()} == {
        "paper's rule": "rule",
        "learned policy": "policy",
    }
    for rival in rivals.values():
        assert this.record.items() <= rival.record.items()
    for latest in (None, this):
        text = contest.first_film(SETUP, latest)
        scene = json.loads(text.split("igw-films", 1)[1].split(">", 1)[1].split("</script>")[0])["scenes"][0]
        ends = [start for start, _ in scene["clock"][1:]] + [scene["end"]]
        length = sum((end - start) * slower for (start, slower), end in zip(scene["clock"], ends, strict=True))
        assert length == pytest.approx(10.0, rel=0.01)
        assert [run["name"] for run in scene["runs"]] == [*rivals, "you" if latest else "person (scripted)"]
