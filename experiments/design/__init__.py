"""`impact-gym design`: for each approach time, search for the coupling that, with its best controller, lowers V_p most.

CMA-ES optimises coupling and controller together on tuning scenarios. The best designs play the test set.
"""
