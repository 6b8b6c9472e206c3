"""Search for the coupling that, with its best controller, leaves the object slowest at each approach time.

`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR` searches coupling and controller together by CMA-ES on
training scenarios, keeps finished searches in DIR, and plays the chosen design on the test set.
"""
