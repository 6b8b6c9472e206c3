"""The solver moves a chain and the object in time.

A chain is imposed motion, robot, coupling and tool. A flight is the motion while tool and object do not touch. Flights
with a formula are computed by it; other flights and all contacts are integrated from event to event.
"""
