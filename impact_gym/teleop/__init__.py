"""Operators, the channels between operator and arm, and the link of both with a controller at the arm."""
