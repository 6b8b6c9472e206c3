"""Speed against error: work-precision diagrams of our solver, SciPy's, what people write by hand, MuJoCo and heyoka.

    `scenes`      six named approaches and a random population of them
    `quantities`  what is compared, and what counts as a failure
    `truth`       the same from the slow independent solver at rtol 1e-13, checked by a second method
    `contenders`  every way to compute an approach that is timed here, with its setting
    `by_hand`     semi-implicit Euler and RK4 at fixed steps, compiled
    `taylor`      Taylor series, by heyoka
    `peer`        the same bodies in MuJoCo, its contact fitted to each scene
    `measure`     times of contenders that take turns, and their errors
    `heat_map`    error and steps over contact stiffness and damping factor
    `summary`     who is cheapest at an error; medians over the population
    `figures`     drawn from the tables
    `__main__`    all of it in order, and the page

After the manner of the work-precision diagrams of SciMLBenchmarks (Rackauckas and others).
"""
