"""The command `impact-gym`, the report, studies, the game, and other programs on top of `agents`."""
