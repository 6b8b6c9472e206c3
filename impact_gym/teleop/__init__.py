"""An operator in the loop: operators, channels, and the link that connects them with the assistance at the arm."""
