"""Studies of the solver: how fast it is at an error, and how robust; each with a page.

    `impact-gym speed`      work-precision diagrams, ours beside SciPy and fixed steps, after the manner of
                            SciMLBenchmarks (Rackauckas and others)
    `impact-gym stability`  robustness on 10,000 random scenes, beside other solvers

    `approaches`   six with a name, the storm
    `solutions`    what a solver says, its errors, the classes of its failures, the truth by the independent solver
    `by_hand`      what people write: fixed steps, and solve_ivp with event functions
    `timing`       contenders timed and judged, in turns or in the storm; who is cheapest at an error
    `storm`        a row for each scene of the storm, with what physics says about the run
    `promises`     what was promised of the storm, and whether it is met; agreement with the independent solver
    `figures`      of both pages, drawn from the tables

Whatever is computed is a job of `agents.jobs`, whose result is kept: hangs and crashes end its process, not the study.
"""
