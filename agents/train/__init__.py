"""Training with stable-baselines3: `ppo` is all of it, from top to bottom."""
