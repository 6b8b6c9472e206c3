"""The page of a study of designs that `agents.design` has made: its front, the chosen design, and what it gains."""
