"""Does it stand? A storm of random scenes over the ranges in which the solver is to work, and who else stands in it.

`scenes`       scene k of the storm, a function of the number k alone
`checks`       what physics says about a run: momentum, energy of contacts, no pull
`workers`      processes that are ended when they say nothing for too long, and the tables that they fill
`storm`        a row for each scene, in a table that an interrupted run leaves behind for the next
`agreement`    the slow independent solver on a random sample
`rivals`       SciPy and fixed steps on the same storm, and solve_ivp with event functions, as people write it
`invariances`  units, frame, order of rows, number of threads, as numbers
`hard_cases`   what makes other solvers fall, measured: onset, grazes, slow contacts, absolute tolerances
`bars`         what was promised, and whether it is met
`page`, `study`
"""
