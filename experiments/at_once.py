"""Processor time of one contact when 1, 8 or 1,024 contacts are solved at once: `python -m experiments.at_once`.

Each contact has another object mass. Tool on a spring of 50 N/m, restitution 0.5, 1e5 N/m^1.5, flange at 1 m/s without
a brake. Every solver stops at the separation, and is compared at its coarsest tolerance with an error below 1e-6 m/s.
"""

from collections.abc import Callable
from time import process_time

import heyoka as hy
import numpy as np

import impact_gym as ig
from experiments.lab.scenes import STEADY, scene
from experiments.studies.solvers.pieces import BESIDE, FOREVER, SPRING, STATE, PARAMETERS, equations, law_of

CHAIN = scene(1e5, 0.5, ig.SpringDamper(50.0))
ERROR, ROUNDS = 1e-6, 5


CONTACT = (equations, SPRING)


def starts(masses):
    """Return states and parameters (rows, k) at the touch, speeds (m/s), starts and ends (s) of contacts, and V_p."""
    found = []
    for mass in masses:
        chain = scene(1e5, 0.5, ig.SpringDamper(50.0), object_mass=mass)
        contact = ig.simulate(chain, STEADY, 1.5, 1e-13).contacts[0]
        trace = ig.simulate(chain, STEADY, contact.start, 1e-13, trace=True).trace
        y, q = trace.tool_position[-1] - trace.flange_position[-1], trace.tool_velocity[-1] - trace.flange_velocity[-1]
        law, _ = law_of(chain)
        speed, M = contact.approach_velocity, chain.tool.mass * mass / (chain.tool.mass + mass)
        length = (M * speed**2 / 1e5) ** 0.4
        state = [BESIDE, 1.0, 0.0, 0.0, y / length, q / speed]
        found.append((state, [*law, 0.0, 1e9, 0.0, length, speed, 1.0, 0.0, 0.0], speed, contact.start, contact.end, contact.object_velocity))
    return tuple(map(np.array, zip(*found, strict=True)))


def ours(masses, data, rtol):
    _, _, _, start, end, _ = data
    def run(duration):
        if len(masses) == 1:
            return np.array([ig.simulate(scene(1e5, 0.5, ig.SpringDamper(50.0), object_mass=masses[0]), STEADY, duration[0], rtol).object_velocity])
        return ig.sweep(CHAIN, STEADY, {"object.mass": masses}, duration, rtol, threads=1).object_velocity
    chain = scene(1e5, 0.5, ig.SpringDamper(50.0), object_mass=masses[0])
    if len(masses) == 1:
        call = lambda d: ig.simulate(chain, STEADY, d, rtol)
        v = lambda o: np.array([o.object_velocity])
        before, after = float(start[0]), float(end[0])
    else:
        call = lambda d: ig.sweep(CHAIN, STEADY, {"object.mass": masses}, d, rtol, threads=1)
        v = lambda o: o.object_velocity
        before, after = start, end
    best = [np.inf, np.inf]
    for _ in range(10):
        for k, d in enumerate((before, after)):
            n, begun = 0, process_time()
            while process_time() - begun < 0.02:
                out = call(d); n += 1
            best[k] = min(best[k], (process_time() - begun) / n)
    return best[1] - best[0], best[1], v(call(after))


def heyoka(masses, data, tol, lanes):
    states, pars, speeds, *_ = data
    symbols, par = hy.make_vars(*STATE), tuple(hy.par[k] for k in range(len(PARAMETERS)))
    derivatives, gauges = equations(SPRING, True, hy.sqrt)(symbols, par)
    system = [(a, hy.expression(0.0) + b) for a, b in zip(symbols, derivatives, strict=True)]
    if lanes == 1:
        ta = hy.taylor_adaptive(system, [0.0] * 6, tol=tol, t_events=[hy.t_event(gauges[0], direction=hy.event_direction.negative)])
        npar = len(ta.pars)
        def call():
            out, spent = np.empty(len(masses)), 0.0
            for i in range(len(masses)):
                ta.time = 0.0; ta.state[:] = states[i]; ta.reset_cooldowns(); ta.pars[:] = pars[i][:npar]
                begun = process_time(); ta.propagate_for(FOREVER); spent += process_time() - begun
                out[i] = ta.state[2]
            return spent, out * speeds
    else:
        ta = hy.taylor_adaptive_batch(system, np.zeros((6, lanes)), tol=tol, t_events=[hy.t_event_batch(gauges[0], direction=hy.event_direction.negative)])
        npar = len(ta.pars)
        def call():
            out, spent = np.empty(len(masses)), 0.0
            for i in range(0, len(masses), lanes):
                ta.set_time(0.0); ta.state[:] = states[i:i+lanes].T; ta.reset_cooldowns(); ta.pars[:] = pars[i:i+lanes].T[:npar]
                left = np.full(lanes, FOREVER)
                while left.any():
                    begun = process_time(); ta.propagate_for(left); spent += process_time() - begun
                    for k, res in enumerate(ta.propagate_res):
                        if left[k] and int(res[0]) == -1:
                            out[i + k], left[k] = ta.state[2, k], 0.0
            return spent, out * speeds
    return timed(call)


def timed(call):
    call()
    best = np.inf
    begun = process_time()
    rounds = 0
    while rounds < 5 or process_time() - begun < 0.5:
        spent, v = call()
        best = min(best, spent); rounds += 1
        if rounds > 300: break
    return best, best, v


def diffrax(masses, data, tol):
    import jax, jax.numpy as jnp, diffrax as dfx, optimistix
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    both = equations(SPRING, True, jnp.sqrt)
    states, pars, speeds, *_ = data
    def rates(t, y, par):
        values = both(tuple(y), tuple(par))[0]
        return jnp.stack([values[0], *(jnp.where(y[0] >= 0.0, v, 0.0) for v in values[1:])])
    def run(state, par):
        found = dfx.diffeqsolve(dfx.ODETerm(rates), dfx.Dopri8(), 0.0, FOREVER, None, state, par, max_steps=4096, throw=False,
            event=dfx.Event(lambda t, y, args, **_: y[0], optimistix.Newton(1e-10, 1e-10), False),
            stepsize_controller=dfx.PIDController(tol, 1e-2 * tol))
        return found.ys[-1][2]
    many = jax.jit(jax.vmap(run))
    a, b = jnp.array(states), jnp.array(pars)
    def call():
        begun = process_time(); v = np.asarray(many(a, b)); return process_time() - begun, v * speeds
    return timed(call)


if __name__ == "__main__":
    for rows in (1, 8, 1024):
        masses = np.geomspace(0.1, 1.0, rows) if rows > 1 else np.array([0.25])
        data = starts(masses)
        for name, solve in (("impact_gym", lambda tol: ours(masses, data, tol)), ("heyoka", lambda tol: heyoka(masses, data, tol, 1)),
                ("heyoka, batches of 4", lambda tol: heyoka(masses, data, tol, 4)), ("heyoka, batches of 8", lambda tol: heyoka(masses, data, tol, 8))):
            if "batches" in name and rows < 8: continue
            for k in range(3, 13):
                spent, whole, v = solve(10.0**-k)
                error = np.abs(v - data[5]).max()
                if error < ERROR or k == 12:
                    print(f"{rows:5} {name:22} tol 1e-{k:<3} error {error:.1e} m/s, {1e6*spent/rows:8.2f} us per contact, whole {1e6*whole/rows:.1f}", flush=True)
                    break
