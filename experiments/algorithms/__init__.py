"""Which algorithm learns the approach best in the same time."""
