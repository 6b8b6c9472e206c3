"""What the studies of speed and stability share: approaches, solutions with their errors, and who computes them."""
