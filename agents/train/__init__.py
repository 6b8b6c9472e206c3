"""Training with stable-baselines3; read `ppo` from top to bottom."""
