"""Approaches (a scene and a motion), and the solvers that simulate them, for the studies `speed` and `stability`."""
