"""Training with stable-baselines3: `settings` say what, `ppo` is how, `run` does it and keeps what came of it."""
