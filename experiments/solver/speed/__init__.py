"""The page about speed against error."""
