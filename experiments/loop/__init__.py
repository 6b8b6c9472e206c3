"""An exported controller at 1 kHz beside a simulated arm in another process, over UDP: `python -m experiments.loop`.

`loop.c.jinja` is the controller's side, `arm.py` the arm's, `faults.py` a wire between them that fails when it is asked
to. Both sides have a watchdog: silence or bad packets for SILENCE stop the arm, which says why.
"""

MAGIC = b"IGLOOP01"
SILENCE = 0.1  # s
PERIOD = 1e-3  # s
EARLY = 1e-3  # s, by which a stamp may be ahead of the arm's clock
