"""Hits that somebody has measured, beside what a simple blow predicts of them: `impact-gym measured`."""
