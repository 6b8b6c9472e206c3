"""The physical laws of contact, coupling and robot, as functions of plain numbers that do not depend on the solver."""
