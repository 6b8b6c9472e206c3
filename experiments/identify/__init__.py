"""How well `impact_gym.identify` finds what an independent solver put into a log."""
