"""The physical laws of contact, coupling and robot, as functions that do not depend on the solver."""
