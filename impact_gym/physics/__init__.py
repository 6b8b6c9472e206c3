"""The physical laws of contact, coupling and robot."""
