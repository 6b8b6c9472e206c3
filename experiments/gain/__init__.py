"""What the gain is made of: how much is knowing where objects can stand, and what is left of it in other worlds."""
