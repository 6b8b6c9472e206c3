"""The 8(5,3) pair of Dormand and Prince, DOP853 in Hairer and Wanner's code, and its steps written out for each chain.

Order 8, 12 stages, first same as last. Coefficients, error estimates and dense output of order 7: Hairer, Norsett,
Wanner, Solving Ordinary Differential Equations I (1993), II.10, in double precision.

The kernels take a step as straight-line code on local variables, which a compiler keeps in registers: half the time of
loops over a table in memory. Nobody writes that by hand: `python -m impact_gym.solver.tableau` writes
`dop853.pxi` from the numbers below, and a test says whether it still does.
"""

from dataclasses import dataclass
from pathlib import Path

# fmt: off
A: tuple[dict[int, float], ...] = (
    {},
    {0: 0.05260015195876773},
    {0: 0.0197250569845379, 1: 0.0591751709536137},
    {0: 0.02958758547680685, 2: 0.08876275643042054},
    {0: 0.2413651341592667, 2: -0.8845494793282861, 3: 0.924834003261792},
    {0: 0.037037037037037035, 3: 0.17082860872947386, 4: 0.12546768756682242},
    {0: 0.037109375, 3: 0.17025221101954405, 4: 0.06021653898045596, 5: -0.017578125},
    {0: 0.03709200011850479, 3: 0.17038392571223998, 4: 0.10726203044637328, 5: -0.015319437748624402,
     6: 0.008273789163814023},
    {0: 0.6241109587160757, 3: -3.3608926294469414, 4: -0.868219346841726, 5: 27.59209969944671,
     6: 20.154067550477894, 7: -43.48988418106996},
    {0: 0.47766253643826434, 3: -2.4881146199716677, 4: -0.590290826836843, 5: 21.230051448181193,
     6: 15.279233632882423, 7: -33.28821096898486, 8: -0.020331201708508627},
    {0: -0.9371424300859873, 3: 5.186372428844064, 4: 1.0914373489967295, 5: -8.149787010746927,
     6: -18.52006565999696, 7: 22.739487099350505, 8: 2.4936055526796523, 9: -3.0467644718982196},
    {0: 2.273310147516538, 3: -10.53449546673725, 4: -2.0008720582248625, 5: -17.9589318631188, 6: 27.94888452941996,
     7: -2.8589982771350235, 8: -8.87285693353063, 9: 12.360567175794303, 10: 0.6433927460157636},
    {0: 0.054293734116568765, 5: 4.450312892752409, 6: 1.8915178993145003, 7: -5.801203960010585,
     8: 0.3111643669578199, 9: -0.1521609496625161, 10: 0.20136540080403034, 11: 0.04471061572777259},
    {0: 0.056167502283047954, 6: 0.25350021021662483, 7: -0.2462390374708025, 8: -0.12419142326381637,
     9: 0.15329179827876568, 10: 0.00820105229563469, 11: 0.007567897660545699, 12: -0.008298},
    {0: 0.03183464816350214, 5: 0.028300909672366776, 6: 0.053541988307438566, 7: -0.05492374857139099,
     10: -0.00010834732869724932, 11: 0.0003825710908356584, 12: -0.00034046500868740456, 13: 0.1413124436746325},
    {0: -0.42889630158379194, 5: -4.697621415361164, 6: 7.683421196062599, 7: 4.06898981839711, 8: 0.3567271874552811,
     12: -0.0013990241651590145, 13: 2.9475147891527724, 14: -9.15095847217987},
)
"""Weights of the earlier stages in each stage; row 12 is also the solution, rows 13 to 15 serve dense output alone."""
ERROR = (
    {0: 0.01312004499419488, 5: -1.2251564463762044, 6: -0.4957589496572502, 7: 1.6643771824549864,
     8: -0.35032884874997366, 9: 0.3341791187130175, 10: 0.08192320648511571, 11: -0.022355307863886294},
    {0: -0.18980075407240762, 5: 4.450312892752409, 6: 1.8915178993145003, 7: -5.801203960010585,
     8: -0.4226823213237919, 9: -0.1521609496625161, 10: 0.20136540080403034, 11: 0.02265179219836082},
)
"""Weights of the stages in the estimates of order 5 and of order 3."""
DENSE = (
    {0: -8.428938276109013, 5: 0.5667149535193777, 6: -3.0689499459498917, 7: 2.38466765651207, 8: 2.117034582445028,
     9: -0.871391583777973, 10: 2.2404374302607883, 11: 0.6315787787694688, 12: -0.08899033645133331,
     13: 18.148505520854727, 14: -9.194632392478356, 15: -4.436036387594894},
    {0: 10.427508642579134, 5: 242.28349177525817, 6: 165.20045171727028, 7: -374.5467547226902,
     8: -22.113666853125306, 9: 7.733432668472264, 10: -30.674084731089398, 11: -9.332130526430229,
     12: 15.697238121770845, 13: -31.139403219565178, 14: -9.35292435884448, 15: 35.81684148639408},
    {0: 19.985053242002433, 5: -387.0373087493518, 6: -189.17813819516758, 7: 527.8081592054236,
     8: -11.57390253995963, 9: 6.8812326946963, 10: -1.0006050966910838, 11: 0.7777137798053443,
     12: -2.778205752353508, 13: -60.19669523126412, 14: 84.32040550667716, 15: 11.99229113618279},
    {0: -25.69393346270375, 5: -154.18974869023643, 6: -231.5293791760455, 7: 357.6391179106141, 8: 93.40532418362432,
     9: -37.45832313645163, 10: 104.0996495089623, 11: 29.8402934266605, 12: -43.53345659001114, 13: 96.32455395918828,
     14: -39.17726167561544, 15: -149.72683625798564},
)
"""Weights of the stages in the upper four coefficients of the polynomial through a step."""
# fmt: on

OUT = Path(__file__).with_name("dop853.pxi")
NOTICE = '''"""The steps of `solver/tableau.py` written out by `python -m impact_gym.solver.tableau`: edit that."""'''
LAST = 12  # the stage at the end of the step
KEPT = range(5, LAST)  # stages that dense output needs beside the first and the last


@dataclass(frozen=True)
class Layout:
    """The places of a chain's scaled state."""

    name: str  # of its functions
    places: str  # a letter each, in order
    felt: str  # those that the rates depend on; the others are integrals alone


LAYOUTS = (
    Layout("rigid", "zwtp", "zw"),
    Layout("spring", "zwtpyvq", "zwyv"),
    Layout("integrated", "zwtpyvsjqr", "zwtyvqr"),
)


def weighed(weights: dict[int, float], place: str) -> str:
    """Return the sum of the stages' rates of a place."""
    return " + ".join(f"{weight!r} * k{stage}.{place}" for stage, weight in weights.items())


def moved(stage: int, place: str, newest: bool) -> str:
    """Return the assignment of a place at a stage; the newest rate is added last, so that little waits for it."""
    *earlier, last = A[stage].items()
    if not newest:
        return f"{place}{stage} = {place}0 + h * ({weighed(A[stage], place)})"
    start = f"({place}0 + h * ({weighed(dict(earlier), place)}))" if earlier else f"{place}0"
    return f"{place}{stage} = {start} + h{stage} * k{last[0]}.{place}"


def stage_lines(layout: Layout, stage: int) -> list[str]:
    """Return the lines that find the state at a stage and the rates there."""
    lines = [f"h{stage} = h * {list(A[stage].values())[-1]!r}"]
    lines += [moved(stage, place, newest=True) for place in layout.felt]
    arguments = ", ".join(f"{place}{stage}" for place in layout.felt)
    return [*lines, f"k{stage} = {layout.name}_rates(now, {arguments})"]


def header(layout: Layout, name: str, stages: range, given: dict[int, str]) -> list[str]:
    """Return the head of a function that starts at `work.x`, with the rates that are `given` somewhere."""
    kind = f"{layout.name.title()}Rates"
    return [
        f"cdef {name} noexcept nogil:",
        f"    cdef {kind} {', '.join(f'k{stage}' for stage in (*given, *stages))}",
        f"    cdef double {', '.join(f'{place}0 = work.x[{i}]' for i, place in enumerate(layout.places))}",
        f"    cdef double {', '.join(f'{place}{stage}' for stage in stages for place in layout.felt)}",
        f"    cdef double {', '.join(f'h{stage}' for stage in stages)}",
        *(f"    memcpy(&k{stage}, {where}, sizeof({kind}))" for stage, where in given.items()),
    ]


def step(layout: Layout) -> list[str]:
    """Return a step from `work.x` into `work.trial`, and the estimate of its error."""
    integrals = [place for place in layout.places if place not in layout.felt]
    lines = header(
        layout, f"double {layout.name}_step(const Piece *now, Work *work, double h)",
        range(1, LAST + 1), {0: "work.rate"},
    )  # fmt: skip
    body = ["cdef double e5, e3, size, fifth = 0.0, third = 0.0"]
    if integrals:
        body.append(f"cdef double {', '.join(f'{place}{LAST}' for place in integrals)}")
    for stage in range(1, LAST + 1):
        body += stage_lines(layout, stage)
    body += [moved(LAST, place, newest=False) for place in integrals]
    for place in layout.places:
        body += [f"e{5 - 2 * i} = {weighed(weights, place)}" for i, weights in enumerate(ERROR)]
        body.append(f"size = 1.0 / max(max(fabs({place}0), fabs({place}{LAST})), 1.0)")
        body.append("fifth += (e5 * size) * (e5 * size)")
        body.append("third += (e3 * size) * (e3 * size)")
    body += [f"work.trial[{i}] = {place}{LAST}" for i, place in enumerate(layout.places)]
    body += [f"work.late[{layout.places.index(place)}] = {place}{LAST - 1}" for place in layout.felt]
    body += [f"memcpy(work.stage[{i}], &k{stage}, sizeof(k{stage}))" for i, stage in enumerate(KEPT)]
    body += [f"memcpy(work.trial_rate, &k{LAST}, sizeof(k{LAST}))", "if not isfinite(fifth + third):"]
    body += ["    return INFINITY", "if fifth == 0.0:", "    return 0.0"]
    body.append(f"return h * fifth / (now.tolerance * sqrt((fifth + 0.01 * third) * {len(layout.places)}.0))")
    return lines + ["    " + line for line in body]


def dense(layout: Layout) -> list[str]:
    """Return what finds the upper coefficients of the polynomial through the last step."""
    given = {0: "work.rate", **{stage: f"work.stage[{i}]" for i, stage in enumerate(KEPT)}, LAST: "work.trial_rate"}
    stages = range(LAST + 1, len(A))
    lines = header(layout, f"void {layout.name}_dense(const Piece *now, Work *work, double h)", stages, given)
    body = [line for stage in stages for line in stage_lines(layout, stage)]
    for i, weights in enumerate(DENSE):
        body += [f"work.dense[{3 + i}][{j}] = h * ({weighed(weights, place)})" for j, place in enumerate(layout.places)]
    return lines + ["    " + line for line in body]


def eigenvalue(layout: Layout) -> list[str]:
    """Return what compares the last two stages, see `solver/stepper.pxi`."""
    lines = [f"cdef double {layout.name}_eigenvalue(const Work *work) noexcept nogil:"]
    body = ["cdef double apart, rates = 0.0, states = 0.0"]
    for place in layout.felt:
        i = layout.places.index(place)
        body += [f"apart = work.trial_rate[{i}] - work.stage[{len(KEPT) - 1}][{i}]", "rates += apart * apart"]
        body += [f"apart = work.trial[{i}] - work.late[{i}]", "states += apart * apart"]
    body.append("return sqrt(rates / states) if states > 0.0 else 0.0")
    return lines + ["    " + line for line in body]


def written() -> str:
    """Return the text of `dop853.pxi`."""
    parts = [NOTICE, *("\n".join(write(layout)) for layout in LAYOUTS for write in (step, dense, eigenvalue))]
    return "\n\n\n".join(parts) + "\n"


if __name__ == "__main__":
    OUT.write_text(written(), encoding="utf-8")
