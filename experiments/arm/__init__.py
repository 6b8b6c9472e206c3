"""Whole arms beside the one mass on a spring that the paper makes of them: `impact-gym arm`."""
