"""Training with stable-baselines3; begin reading with the module `ppo`."""
