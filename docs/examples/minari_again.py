"""An episode of a Minari dataset begins again, with its seed and options."""

import sys

import minari

dataset = minari.load_dataset(sys.argv[1] if sys.argv[1:] else "impact/linear-blind/policy-v0")
env = dataset.recover_environment()
about = next(iter(dataset.storage.get_episode_metadata([0])))
observation, _ = env.reset(seed=about["seed"], options=about["options"])
print("begins as recorded:", observation.tolist() == dataset[0].observations[0].tolist())
