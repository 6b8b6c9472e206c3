"""An exported controller in C at 1 kHz beside a simulated arm in another process, over UDP."""
