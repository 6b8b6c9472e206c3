"""An operator in the loop: operators, channels, whether they fit a task, and the link that is compiled."""
