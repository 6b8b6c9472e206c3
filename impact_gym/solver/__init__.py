"""The motion of a chain in time: exact flights, contacts integrated from event to event, and the loop over both."""
