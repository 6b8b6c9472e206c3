"""The solver: moves flange, tool and object in time.

"Chain" means imposed motion, robot, coupling and tool, up to the object. "Flight" means motion while tool and object do
not touch. Flights are exact where a formula exists; other flights and all contacts are integrated from event to event.
"""
