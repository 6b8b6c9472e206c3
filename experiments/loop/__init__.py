"""A controller exported to C runs at 1 kHz and steers a simulated arm in another process, over UDP."""
