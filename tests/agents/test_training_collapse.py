"""A training that has nothing left to go on from stops, and says why."""

from dataclasses import replace

import pytest
from training import tiny

from agents.jobs import JobsFailedError
from agents.train import callback
from agents.train.callback import CollapsedError
from agents.train.run import resume, train
from agents.train_seeds import Seeds, train_all


@pytest.fixture
def unreachable(tmp_path):
    """Settings of 16 rollouts for an arm that only gets to an object at full speed all along, as nobody begins.

    There is a validation after every second one.
    """
    path = tmp_path / "slow.toml"
    slow = "velocity_range = [-0.2, 0.2]\nscenario = { distance = [0.236, 0.237] }"
    path.write_text(f'title = "Hardly there"\nabout = "at 0.2 m/s"\n[environment]\n{slow}\n')
    return tiny(setup=str(path), validate_every=512, checkpoint_every=256, out=tmp_path / "run")


def test_a_training_that_touches_no_object_stops_with_the_reason(unreachable):
    reason = r"after 1,536 of 4,096 steps: 100\.0% of the objects missed(.|\n)*learning_rate below(.|\n)*log_std below"
    with pytest.raises(CollapsedError, match=f"{reason}(.|\n)*agents.setup .*slow.toml"):
        train(unreachable)
    assert "100.0% of the objects missed" in (unreachable.out / "collapsed.txt").read_text()
    assert not (unreachable.out / "metrics.json").exists()
    with pytest.raises(CollapsedError, match=f"run: the training collapsed {reason}"):
        resume(unreachable.out)


def test_an_interruption_does_not_delay_it(unreachable):
    def interrupt(steps, _):
        if steps == 1024:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(unreachable, interrupt)
    with pytest.raises(CollapsedError, match="after 1,536 of"):
        resume(unreachable.out)


@pytest.mark.parametrize(("missed", "stops_after"), [
    ([1.0, 1.0, 1.0, 1.0], 1024),  # the first of them, in the first tenth of the training, may miss all
    ([0.0] * 13 + [1.0] * 3, 4096),  # at the end, before a policy is called final
    ([1.0, 1.0, 1.0, 0.9] + [1.0, 1.0, 0.0] * 4, None),
], ids=str)  # fmt: skip
def test_three_validations_in_a_row_that_miss_nearly_all_are_a_collapse(tmp_path, monkeypatch, missed, stops_after):
    shares = iter(missed)

    def score(*_):
        result = {"score": 1.0, "time_weight": [1.0], "object_velocity": [0.0], "approach_time": [0.0]}
        return result | {"missed": [next(shares, 0.0)]}

    monkeypatch.setattr(callback.Validation, "score", score)
    settings = tiny(validate_every=256, out=tmp_path / "run")
    if stops_after is None:
        assert (train(settings) / "metrics.json").is_file()
    else:
        with pytest.raises(CollapsedError, match=f"after {stops_after:,} of 4,096 steps"):
            train(settings)


@pytest.mark.parametrize("steps", [4096, 256])
def test_weights_that_are_no_longer_finite_are_a_collapse(tmp_path, steps):
    with pytest.raises(CollapsedError, match=r"no longer finite.*learning_rate below 1e\+30"):
        train(tiny(learning_rate=1e30, steps=steps, out=tmp_path / "run"))
    assert not (tmp_path / "run" / "final.npz").exists()


def test_a_collapsed_seed_is_a_failure_and_is_not_shipped(unreachable, tmp_path):
    options = Seeds((unreachable.setup,), seeds=1, processes=1, runs=tmp_path / "runs", policies=tmp_path / "policies")
    for _ in range(2):  # the second time at once
        with pytest.raises(JobsFailedError, match=r"1 of 1 jobs failed(.|\n)*CollapsedError(.|\n)*objects missed"):
            train_all("slow", options, replace(unreachable, out=None))
    assert not (tmp_path / "policies").exists()
