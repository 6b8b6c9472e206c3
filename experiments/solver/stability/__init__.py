"""The page about stability."""
