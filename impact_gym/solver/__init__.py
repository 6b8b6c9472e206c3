"""How a chain moves in time: exact flight, contacts integrated between located events, and the loop that hands over."""
