"""Rivals: integrators of other libraries for the equations of `pieces`, on one thread.

A library that is not installed raises an ImportError when its rival is first used.
"""

from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np

from experiments.studies.solvers.pieces import BESIDE, GAUGES, PARAMETERS, STATE, Advance, Backend, equations, watched

ABSOLUTE = 1e-2  # absolute tolerance divided by the relative one; states are of order one
AHEAD = 1e-9  # step of the independent variable, after which the sign of a gauge that begins at zero is read
STEPS = 16_384  # most steps of diffrax in one piece


@cache
def heyoka(kind: int, touching: bool, tolerance: float) -> Advance:
    """Return an `Advance` by Taylor series whose order follows from the tolerance (Biscani, Izzo 2021)."""
    hy = import_module("heyoka")
    symbols, par = hy.make_vars(*STATE), tuple(hy.par[place] for place in range(len(PARAMETERS)))
    derivatives, gauges = equations(kind, touching, hy.sqrt)(symbols, par)
    way = {1: hy.event_direction.positive, -1: hy.event_direction.negative, 0: hy.event_direction.any}
    events = [hy.t_event(gauges[place], direction=way[sign]) for place, sign in watched(kind, touching)]
    system = [(symbol, hy.expression(0.0) + rate) for symbol, rate in zip(symbols, derivatives, strict=True)]
    integrator = hy.taylor_adaptive(system, [0.0] * len(STATE), tol=tolerance, t_events=events)
    names = {-1 - at: GAUGES[place] for at, (place, _) in enumerate(watched(kind, touching))}
    names[int(hy.taylor_outcome.time_limit)] = "cut"
    held: list[float] = []

    def advance(state: list[float], parameters: list[float], limit: float) -> tuple[str, list[float]]:
        nonlocal held
        if state is not held:  # else it continues after an event, which must not be found again
            integrator.time, integrator.state[:] = 0.0, state
            integrator.reset_cooldowns()
        integrator.pars[:] = parameters[: len(integrator.pars)]
        outcome = int(integrator.propagate_for(limit)[0])
        held = integrator.state.tolist()
        return names[outcome], held

    return advance


@cache
def _diffrax(kind: int, touching: bool) -> Any:
    """Return the compiled integration of one piece."""
    dfx, jax, jnp, optimistix = map(import_module, ("diffrax", "jax", "jax.numpy", "optimistix"))
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_cpu_enable_async_dispatch", False)  # the work of another thread would not be timed
    both, events = equations(kind, touching, jnp.sqrt), watched(kind, touching)

    def rates(_: Any, state: Any, par: Any) -> Any:
        values = both(tuple(state), tuple(par))[0]
        if touching:  # the state stops at the separation: beyond it the series would diverge
            values = [values[0], *(jnp.where(state[0] >= 0.0, value, 0.0) for value in values[1:])]
        return jnp.stack(values)

    def gauge(t: Any, y: Any, args: Any, place: int, **_: Any) -> Any:
        values, sign = args
        return jnp.where(t < AHEAD, sign[place] * BESIDE, both(tuple(y), tuple(values))[1][place])

    def run(state: Any, par: Any, limit: Any, tolerance: Any) -> Any:
        begin = jnp.stack(both(tuple(state + AHEAD * rates(0.0, state, par)), tuple(par))[1])
        event = dfx.Event(
            [partial(gauge, place=place) for place, _ in events],
            optimistix.Newton(1e-10, 1e-10),
            [None if sign == 0 else sign > 0 for _, sign in events],
        )
        found = dfx.diffeqsolve(
            dfx.ODETerm(lambda t, y, args: rates(t, y, args[0])), dfx.Dopri8(), 0.0, limit, None, state,
            (par, jnp.sign(begin)), event=event, max_steps=STEPS, throw=False,
            stepsize_controller=dfx.PIDController(tolerance, ABSOLUTE * tolerance),
        )  # fmt: skip
        mask = jnp.stack(found.event_mask)
        place = jnp.where(mask.any(), jnp.array([place for place, _ in events])[jnp.argmax(mask)], -1)
        return dfx.is_okay(found.result), place, found.ys[-1]

    return jax.jit(run)


def diffrax(kind: int, touching: bool, tolerance: float) -> Advance:
    """Return an `Advance` by a Runge-Kutta method of order 8 with events, compiled by JAX (Kidger 2021)."""
    run = _diffrax(kind, touching)

    def advance(state: list[float], parameters: list[float], limit: float) -> tuple[str, list[float]]:
        success, place, there = run(np.array(state), np.array(parameters), limit, tolerance)
        if not success:
            raise RuntimeError("the search for an event fails" if place >= 0 else f"more than {STEPS} steps")
        return ("cut" if place < 0 else GAUGES[int(place)]), np.asarray(there).tolist()

    return advance


PEERS: dict[str, Backend] = {"heyoka": heyoka, "diffrax Dopri8": diffrax}
"""Backends by the name of their rival."""
