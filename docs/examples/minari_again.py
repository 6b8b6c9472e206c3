"""Begin the first episode of a Minari dataset again, with its seed and options."""

import sys

import minari

name = sys.argv[1] if sys.argv[1:] else "impact/linear-blind/policy-v0"
dataset = minari.load_dataset(name)
env = dataset.recover_environment()
about = next(iter(dataset.storage.get_episode_metadata([0])))
observation, _ = env.reset(seed=about["seed"], options=about["options"])
recorded = dataset[0].observations[0]
print("begins as recorded:", observation.tolist() == recorded.tolist())
