"""Print purpose, failures and results of policies: `impact-gym policies [NAME ...]`."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import tyro
from scipy.stats import ttest_1samp

from agents.policies import load_ensemble
from agents.setups import load_setup, trained
from impact_gym.support.command_line import run_command
from impact_gym.support.provenance import modern_command

SHIPPED = trained()


@dataclass(frozen=True)
class PolicyCards:
    """Print for each policy what it is for, in which conditions it fails, and its results."""

    names: tyro.conf.Positional[tuple[str, ...]] = SHIPPED
    """Names or files of the policies' set-ups. The default is all shipped policies."""


def card(name: str) -> Iterator[str]:
    """Yield lines about a policy: purpose, when it fails, results on the validation set, command of the training."""
    setup = load_setup(name)
    path = setup.folder / "policies" / f"{setup.name}.npz"
    if not path.is_file():
        train = f"impact-gym train {setup.cli_name} --seeds {setup.seeds}"
        raise ValueError(f"{setup.cli_name} has no policy yet: make {path} with {train}")
    ensemble = load_ensemble(path)
    chosen = ensemble[None].provenance
    yield f"{setup.name}: {setup.title}"
    yield f"  for: {setup.about}"
    yield f"  fails: {setup.fails}"
    seeds, validations = len(ensemble.policies), [policy.provenance["validation"] for policy in ensemble.policies]
    for k, weight in enumerate(chosen["validation"]["time_weight"]):
        time, velocity = (_mean([each[key][k] for each in validations]) for key in ("approach_time", "object_velocity"))
        yield f"  w = {weight:g} m/s per s: T {time} s, V_p {velocity} m/s"
    yield f"  {seeds} seeds, seed {ensemble.chosen} is the median; in brackets the 95 % interval of the mean"
    when = f"{chosen['settings']['steps']:,} steps, {chosen['date'][:10]}, commit {(chosen.get('commit') or '-')[:7]}"
    yield f"  made by: {modern_command(chosen['command'])} ({when})"


def _mean(values: Sequence[float]) -> str:
    if len(values) < 2:
        return f"{values[0]:.3f}"
    low, high = ttest_1samp(values, 0.0).confidence_interval(0.95)
    return f"{np.mean(values):.3f} [{low:.3f}, {high:.3f}]"


def show(options: PolicyCards) -> None:
    """Print the lines about each policy."""
    for name in options.names:
        print(*card(name), sep="\n")
    print('to play a policy: load_policy("NAME"), impact-gym report NAME; for an arm: impact-gym export NAME --out DIR')


if __name__ == "__main__":
    run_command("policies", PolicyCards, show)
