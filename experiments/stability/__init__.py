"""Does it stand? A storm of random scenes over the ranges in which the solver is to work, and who else stands in it.

`scenes`       scene k of the storm, a function of the number k alone
`checks`       what physics says about a run: momentum, energy of contacts, no pull
`storm`        a row for each scene
`agreement`    the slow independent solver on a random sample
`rivals`       SciPy and fixed steps on the same storm, and solve_ivp with event functions, as people write it
`invariances`  units, frame, order of rows, number of threads, as numbers
`hard_cases`   what makes other solvers fall, measured: onset, grazes, slow contacts, absolute tolerances
`promises`     what was promised, and whether it is met
`figures`      drawn from the tables
`__main__`     all of it in order, and the page

Whatever is computed is a job of `agents.jobs`, whose result is kept: hangs and crashes end its process, not the study.
"""
