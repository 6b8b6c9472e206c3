"""The shipped policies: `impact-gym policies`."""

import argparse
from collections.abc import Iterator

from agents import load_policy
from agents.setups import load_setup, shipped


def lines() -> Iterator[str]:
    """Yield what each shipped policy is for, and what it does on the validation set."""
    for name in shipped():
        setup, validation = load_setup(name), load_policy(name).provenance["validation"]
        times, velocities, weights = (validation[key] for key in ("approach_time", "object_velocity", "time_weight"))
        yield f"{name}: {setup.title}"
        yield f"  {setup.about}"
        yield (
            f"  approach in {min(times):.3f} to {max(times):.3f} s, V_p {max(velocities):.3f} to {min(velocities):.3f} "
            f"m/s, at time weights of {max(weights):g} to {min(weights):g} m/s per s"
        )
    yield 'to play one: agents.load_policy("NAME"), impact-gym report NAME; to use it: impact-gym export NAME --out DIR'


if __name__ == "__main__":
    argparse.ArgumentParser(prog="impact-gym policies", description="List the shipped policies.").parse_args()
    print(*lines(), sep="\n")
