"""A control loop at 1 kHz: a controller exported to C steers a simulated arm in another process, over UDP."""
