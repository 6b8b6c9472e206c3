"""Operators, channels between operator and arm, and the link: an operator with two channels."""
