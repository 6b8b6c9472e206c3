"""`impact-gym design`: for each approach time, search for the coupling whose best controller has the lowest V_p."""
