"""Which coupling to build: the design that, with its best controller, leaves the object slowest at each approach time.

`impact-gym design SETUP --free NAME=LOW:HIGH ... --out DIR` searches design and controller together by CMA-ES on
training scenarios, keeps what it has done in DIR, and plays what it chose on the test set.
"""
