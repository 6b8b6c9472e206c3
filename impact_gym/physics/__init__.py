"""The laws of contact, coupling and robot, as functions of numbers, independent of the solver."""
