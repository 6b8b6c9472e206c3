"""Speed, as ratios measured in one run, each beside its error: `python -m experiments.bench`."""
