"""A control loop at 1 kHz over UDP, between a controller that was exported to C and a simulated arm."""
