"""Search, at each approach time, for the coupling that leaves the object slowest with its best controller.

`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR` searches coupling and controller together by CMA-ES on
training scenarios, keeps finished searches in DIR, and plays the found designs on the test set.
"""
