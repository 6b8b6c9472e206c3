"""The solver computes the motion of a chain and the object.

A chain consists of imposed motion, robot, coupling and tool. A flight is the motion while tool and object do not touch.
Flights of simple chains have a formula. Other flights and all contacts are integrated from event to event.
"""
