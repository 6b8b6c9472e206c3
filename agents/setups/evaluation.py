"""How a set-up is evaluated."""

WEIGHTS = (0.7, 1.0, 2.0, 4.0)  # m/s per s
