"""Backends of `pieces`: heyoka, numbalsoda and diffrax, each as its makers mean it to be used, on one thread.

numbalsoda's integrators know no events: they are asked for a grid of times, and where a gauge changes its sign Newton's
method integrates from the last time on the grid again. A library that is missing is an ImportError when it is used.
"""

import math
from collections.abc import Callable
from functools import cache, partial
from importlib import import_module
from typing import Any

import numpy as np

from experiments.studies.solvers.pieces import (
    BESIDE,
    BISTABLE,
    GAUGES,
    PARAMETERS,
    RIGID,
    SPRING,
    STATE,
    Advance,
    Backend,
    equations,
    watched,
)  # fmt: skip

ABSOLUTE = 1e-2  # absolute tolerance over the relative one, of states of order one
MOST = 64  # events of one piece
GRID = 32  # times asked for at once
STRIDES = {SPRING: 1e-2, BISTABLE: 2e-3, RIGID: 0.1}  # s, between them in flight: a tenth of a period at most
STRIDE = 0.4  # likewise in a contact, in its units
PEAK, ALARM = 1, 3  # places in GAUGES of what does not change the equations
AHEAD = 1e-9  # of the independent variable, behind which the sign of a gauge that begins at zero is read
STEPS = 16_384  # most steps of diffrax in one piece


@cache
def heyoka(kind: int, touching: bool, tolerance: float) -> Advance:
    """Taylor series of the order that a tolerance asks for (Biscani, Izzo 2021)."""
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
        if state is not held:  # else it goes on from the event before, which must not come again
            integrator.time, integrator.state[:] = 0.0, state
            integrator.reset_cooldowns()
        integrator.pars[:] = parameters[: len(integrator.pars)]
        outcome = int(integrator.propagate_for(limit)[0])
        held = integrator.state.tolist()
        return names[outcome], held

    return advance


@cache
def _compiled(kind: int, touching: bool) -> tuple[int, Any, Any]:
    """Return numbalsoda's form of the equations: the address of the derivatives, and a function of both."""
    numba, lsoda_sig = import_module("numba"), import_module("numbalsoda").lsoda_sig
    to_fixed_tuple = import_module("numba.np.unsafe.ndarray").to_fixed_tuple

    rates = numba.njit(equations(kind, touching, math.sqrt))
    n, m = len(STATE), len(PARAMETERS)

    @numba.cfunc(lsoda_sig)  # type: ignore[untyped-decorator]  # of a library without types
    def derivatives(_: Any, state: Any, result: Any, par: Any) -> None:
        values = rates(to_fixed_tuple(numba.carray(state, (n,)), n), to_fixed_tuple(numba.carray(par, (m,)), m))[0]
        for i, value in enumerate(values):  # beyond the separation nothing happens; the series there would diverge
            result[i] = value if i == 0 or not touching or state[0] >= 0.0 else 0.0

    @numba.njit  # type: ignore[untyped-decorator]  # of a library without types
    def both(state: Any, par: Any) -> tuple[Any, Any]:
        derivatives, gauges = rates(to_fixed_tuple(state, n), to_fixed_tuple(par, m))
        return np.array(derivatives), np.array(gauges)

    return derivatives.address, both, derivatives


def numbalsoda(method: str, kind: int, touching: bool, tolerance: float) -> Advance:
    """ODEPACK's LSODA or Hairer's DOP853, compiled, with the search for events compiled by Numba."""
    places, directions = (np.array(each) for each in zip(*watched(kind, touching), strict=True))
    address, *_ = _compiled(kind, touching)
    search = _search(method, kind, touching)

    ahead: list[tuple[str, list[float]]] = []
    held: list[float] = []

    def advance(state: list[float], parameters: list[float], limit: float) -> tuple[str, list[float]]:
        nonlocal held, ahead
        cut = parameters[PARAMETERS.index("cut")]
        if state is not held or not ahead or (touching and ahead[0][1][3] > cut):
            arrays = np.array(state), np.array(parameters), places, directions
            found = search(address, *arrays, limit, STRIDE if touching else STRIDES[kind], tolerance)
            if found[-1, 0] < -1:
                raise RuntimeError(f"{method} gives up")
            ahead = [("cut" if place < 0 else GAUGES[int(place)], there) for place, *there in found.tolist()]
        event, held = ahead.pop(0)
        return event, held

    return advance


@cache
def _search(method: str, kind: int, touching: bool) -> Any:
    """Return the compiled search for the first event."""
    numba, solve, both = (
        import_module("numba"),
        getattr(import_module("numbalsoda"), method),
        _compiled(kind, touching)[1],
    )

    @numba.njit  # type: ignore[untyped-decorator]  # of a library without types
    def crossing(address: Any, y: Any, par: Any, place: int, rising: bool, h: float, guess: float, rtol: float) -> Any:
        """Time and state at which a gauge is zero, from y on and before h, by Newton's method within a bracket."""
        low, high, at, there = 0.0, h, guess, y
        for _ in range(60):
            found, _ = solve(address, y, np.array([0.0, at]), par, rtol, ABSOLUTE * rtol)
            there = found[1]
            rates, gauges = both(there, par)
            slope = (both(there + AHEAD * rates, par)[1][place] - gauges[place]) / AHEAD
            change = -gauges[place] / slope if (slope > 0.0) == rising else np.inf  # inf: of the crossing before
            if change * change < 0.01 * rtol:  # what a step by the slope leaves
                there = there + change * rates
                break
            if (gauges[place] < 0.0) == rising:
                low = at
            else:
                high = at
            at = at + change if low < at + change < high else 0.5 * (low + high)
        return at, there

    @numba.njit  # type: ignore[untyped-decorator]  # of a library without types
    def search(address: Any, y: Any, par: Any, places: Any, ways: Any, limit: float, h: float, rtol: float) -> Any:
        """The events up to the first one behind which the equations change: a row of place and state for each."""
        t, begin, passed, n = 0.0, both(y + AHEAD * both(y, par)[0], par)[1], np.empty((MOST, len(y) + 1)), 0
        roots = np.empty((len(places), len(y) + 2))
        while n < MOST - len(places):
            times = np.minimum(h * np.arange(GRID + 1), limit - t)
            last = np.searchsorted(times, times[-1])
            found, success = solve(address, y, times[: last + 1], par, rtol, ABSOLUTE * rtol)
            if not success or not np.isfinite(found).all():
                passed[n, 0] = -2
                return passed[: n + 1]
            for i in range(last):
                end, m = both(found[i + 1], par)[1], 0
                for place, way in zip(places, ways):  # noqa: B905  # Numba knows no strict
                    g, g_end, step = begin[place], end[place], times[i + 1] - times[i]
                    if (g < 0.0 <= g_end and way >= 0) or (g > 0.0 >= g_end and way <= 0):
                        guess = step * g / (g - g_end)
                        at, there = crossing(address, found[i].copy(), par, place, g < 0.0, step, guess, rtol)
                        roots[m, 0], roots[m, 1], roots[m, 2:], m = at, place, there, m + 1
                for j in np.argsort(roots[:m, 0]):
                    passed[n], n = roots[j, 1:], n + 1
                    if roots[j, 1] != PEAK and roots[j, 1] != ALARM:
                        return passed[:n]
                begin = end
            t, y = t + times[-1], found[last].copy()
            if t >= limit:
                passed[n, 0], passed[n, 1:] = -1, y
                return passed[: n + 1]
        passed[n, 0] = -2
        return passed[: n + 1]

    return search


@cache
def diffrax(kind: int, touching: bool, tolerance: float) -> Advance:
    """Runge-Kutta of order 8 with events, compiled by JAX (Kidger 2021)."""
    run = _diffrax_piece(kind, touching)

    def advance(state: list[float], parameters: list[float], limit: float) -> tuple[str, list[float]]:
        success, place, there = run(np.array(state), np.array(parameters), limit, tolerance)
        if not success:
            raise RuntimeError("the search for an event fails" if place >= 0 else f"more than {STEPS} steps")
        return ("cut" if place < 0 else GAUGES[int(place)]), np.asarray(there).tolist()

    return advance


@cache
def _diffrax_piece(kind: int, touching: bool) -> Callable[..., Any]:
    dfx, jax, jnp, optimistix = map(import_module, ("diffrax", "jax", "jax.numpy", "optimistix"))
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_cpu_enable_async_dispatch", False)  # what another thread does would not be timed
    both, events = equations(kind, touching, jnp.sqrt), watched(kind, touching)

    def rates(_: Any, state: Any, par: Any) -> Any:
        values = both(tuple(state), tuple(par))[0]
        going_on = (state[0] >= 0.0) if touching else True  # as above
        return jnp.stack([values[0], *(jnp.where(going_on, value, 0.0) for value in values[1:])])

    def gauge(t: Any, y: Any, args: Any, place: int, **_: Any) -> Any:
        values, sign = args
        return jnp.where(t < AHEAD, sign[place] * BESIDE, both(tuple(y), tuple(values))[1][place])

    @jax.jit  # type: ignore[untyped-decorator]  # of a library without types
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

    return run


PEERS: dict[str, Backend] = {
    "heyoka": heyoka,
    "numbalsoda lsoda": partial(numbalsoda, "lsoda"),
    "numbalsoda dop853": partial(numbalsoda, "dop853"),
    "diffrax Dopri8": diffrax,
}
"""Backends by name: the library, and which of its methods."""
