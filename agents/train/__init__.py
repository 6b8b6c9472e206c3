"""Training with stable-baselines3; the main module is `ppo`."""
