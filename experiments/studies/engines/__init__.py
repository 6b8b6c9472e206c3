"""`impact-gym study engines`: the same blow in physics engines; `--only NAME` measures one engine.

An engine that is not installed, crashes, hangs or refuses is a row that says so: each cell runs in a process of its
own, with a time limit.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from functools import partial
from itertools import product
from typing import Any

from experiments.lab.parts import Section, Table
from experiments.lab.study import SOLVER, Cell, Findings, Frames, Measurement, Row, Study
from experiments.studies import QUESTIONS
from experiments.studies.engines.cases import read
from experiments.studies.engines.drive import SAME, Variant, engine, measured

OURS, EXACT = "ours", "exact"
ENGINES = (OURS, "mujoco", "newton", "drake", "physx", "bullet", "rapier")
STEPS, DEFAULT = (2e-3, 1e-3, 5e-4, 1e-4, 1e-5), 2e-3  # s
OTHERS = (2e-3, 1e-4)  # s, steps of other cases than BLOWS
SLOW = {"newton": (2e-3,)}  # s, likewise; at 0.1 ms, Newton on the CPU takes 20 s per simulated s
BLOWS = ("restitution-0.1", "restitution-0.5", "restitution-1")  # also the cases of a quick study
SECONDS = 300.0  # s, time limit of a cell, with what an engine compiles
MOMENTUM = 1e-6  # relative error of the momentum above which a variant is marked
COLUMNS = ("engine", "version", "case", "step", "restitution", "delivered", "spread", "object_velocity", "peak_force",
           "impulse", "duration", "energy", "momentum_error", "seconds", "failure")  # fmt: skip


def cells(quick: bool, _: Frames, name: str) -> Iterator[Cell]:
    """Yield a cell for each variant, case and step of an engine; the exact solution has no step.

    Only BLOWS have all STEPS; the other cases, which a quick study leaves out, have fewer.
    """
    (module, installed), few = engine(name), OTHERS if quick else SLOW.get(name, OTHERS)
    for case in read().values():
        if case.name in BLOWS or not quick:
            exact = [(EXACT, None)] * (name == OURS)
            for variant, step in [*exact, *product(module.VARIANTS, few if quick or case.name not in BLOWS else STEPS)]:
                labels = {"variant": variant, "case": case.name, "step": step}
                yield Cell(labels, {"name": name, **labels, "case": asdict(case), "installed": installed})


def rows_of(frames: Frames) -> list[dict[str, Any]]:
    """Return the rows of all measured engines with engine, version, the restitution asked for, and how."""
    rows, cases = list[dict[str, Any]](), read()
    for name, frame in frames.items():
        module, installed = engine(name)
        for row in frame.to_dicts():
            way = module.VARIANTS.get(row["variant"], Variant("k_c and e", SAME))
            about = {"engine": f"{module.PACKAGE}, {row['variant']}", "package": module.PACKAGE, "version": installed}
            asked = {"restitution": cases[row["case"]].restitution, "asked": way.asked, "law": way.law}
            rows.append({"failure": "", **row, **about, **asked})
    return rows


def shown(row: Row | None, name: str, form: str, scale: float = 1.0) -> str:
    """Return a number of a row as text, or why there is none; a restitution with half its range over the phases."""
    if row is None or row.get(name) is None:
        return str((row and row["failure"]) or "-").partition(":")[0]
    half = (row["spread"] or 0.0) / 2 if name == "delivered" else 0.0
    return format(scale * row[name], form) + (f" ± {half:.4f}" if half >= 1e-4 else "")


def compared(rows: Sequence[Row]) -> Table:
    """Return the table of the blow of reference, at the default step and at the finest step that has numbers."""
    lines = []
    for label in dict.fromkeys(row["engine"] for row in rows):
        of = {(row["case"], row["step"]): row for row in rows if row["engine"] == label}
        steps = {step for (case, step), row in of.items() if case == BLOWS[1] and row.get("delivered") is not None}
        usual, finest = None if None in steps else DEFAULT, min(steps, key=lambda step: step or 0.0, default=DEFAULT)
        middle, end = of.get((BLOWS[1], usual)), of.get((BLOWS[1], finest))
        wrong = max(row.get("momentum_error") or 0.0 for row in of.values())
        line = {"engine": label, "asked of it": next(iter(of.values()))["asked"]}
        for case in BLOWS:
            line[f"e = {case.partition('-')[2]}"] = shown(of.get((case, usual)), "delivered", ".4f")
        line["peak force / exact"] = shown(middle, "peak", ".2f")
        for figure in ("17b", "19a"):
            line[f"V_p, Fig. {figure}, % off"] = shown(of.get((f"figure-{figure}", usual)), "off", "z.1f", 100.0)
        line |= {
            "time, s per s": shown(middle, "seconds", ".2g"),
            "step, µs": f"{1e6 * finest:g}" if finest else "none",
        }
        line |= {"e = 0.5 then": shown(end, "delivered", ".4f"), "peak / its law's": shown(end, "peak_law", ".4f")}
        lines.append(
            line | {"momentum off": (f"{wrong:.0e}" if finest else "-") + " (above 1e-6)" * (wrong > MOMENTUM)}
        )
    caption = "The blow of reference: step of 2 ms, and what the finest step changes"
    return Table.joined(caption, lines, "engines-blow")


def analyse(frames: Frames, quick: bool) -> Findings:
    """Compare the engines."""
    rows = rows_of(frames)
    numbers = {row["package"] for row in rows if row.get("object_velocity") is not None}
    answer = f"{len(numbers)} of {len({row['package'] for row in rows})} engines have numbers."
    if ours := [abs(row["off"]) for row in rows if row["variant"] == EXACT and row["restitution"]]:
        answer += f" impact_gym differs from the answers by at most {max(ours):.0e} of V_p."
    text = (
        "Mean over four positions of the touch within a step, ± half the range; docs/physics/engines.md has the rest."
    )
    every = [[f"{value:.6g}" if isinstance(value := row.get(name), float) else str(value or "") for name in COLUMNS]
             for row in rows]  # fmt: skip
    runs = Section("All runs", [Table("All runs, SI", COLUMNS, every, "engines")], folded=True)
    return Findings(answer, [Section("The blow of reference", [text, compared(rows)]), runs])


def measurement(name: str) -> Measurement:
    """Return the measurement of an engine: a module here, or the full name of a module elsewhere."""
    depends = (*SOLVER, f"{__name__}.cases", engine(name)[0].__name__, "experiments.reference.command")
    return Measurement(name, partial(cells, name=name), measured, depends, failed=lambda _: {}, seconds=SECONDS)


STUDY = Study("engines", QUESTIONS["engines"], [*map(measurement, ENGINES)], analyse)
