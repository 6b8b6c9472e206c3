"""Search, at each approach time, for the coupling with which, under its best controller, V_p is lowest.

`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR` optimises coupling and controller together by CMA-ES on
tuning scenarios, keeps finished searches in DIR, and plays the best designs on the test set.
"""
