"""An operator in the loop: operators, channels, and the link of both with the assistance at the arm."""
