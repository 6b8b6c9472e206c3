"""Write the generated parts of the pages (tables, listings, pictures), and convert formulas to MathML for MkDocs.

`python docs/generated.py` writes the pictures in docs/pictures. In each page, it replaces the text between
`<!-- generated: NAME -->` and `<!-- end -->` by the return value of TEXTS[NAME], or by the content of the file NAME;
`<!-- results: NAME -->` is followed by the table of docs/results/NAME.csv without its empty rows, of which
`<!-- results: NAME | COLUMN | COLUMN -->` shows only some columns, with `=TEXT` in place of a first column only rows
whose name has this text, and `<!-- cell: NAME | ROW | COLUMN -->` by a number of this table, without its interval (with
`<!-- interval: ... -->`, the interval as well).
MkDocs calls `on_page_content` and `on_post_build`.
"""

import contextlib
import html
import inspect
import io
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
import matplotlib as mpl
import numpy as np
import polars as pl
from latex2mathml.converter import convert
from matplotlib.figure import Figure

import impact_gym as ig
from agents.setups import load_setup, shipped
from experiments.lab import results
from impact_gym.envs import IDS
from impact_gym.envs.single import ImpactApproachEnv
from impact_gym.physics.dissipation import PUBLISHED, effective_restitution

DOCS = Path(__file__).parent
REGION = re.compile(r"(<!-- (generated|results): (\S+)(| \| [^\n]+) -->\n).*?(<!-- end -->)", re.DOTALL)
NUMBER = re.compile(r"(<!-- (cell|interval): ([^|]+?) \\?\| ([^|]+?) \\?\| (.+?) -->).*?(<!-- end -->)")
GREY, BLUE, ORANGE, GREEN = "#808080", "#0072B2", "#D55E00", "#009E73"  # legible on a light and on a dark page
STYLE = {
    "axes.edgecolor": GREY, "axes.labelcolor": GREY, "xtick.color": GREY, "ytick.color": GREY, "text.color": GREY,
    "axes.spines.top": False, "axes.spines.right": False, "font.size": 11, "svg.fonttype": "none",
    "font.family": "sans-serif", "legend.frameon": False, "svg.hashsalt": "impact_gym",
}  # fmt: skip


def filled(markdown: str) -> str:
    """Return a page with its generated parts up to date."""

    def region(found: re.Match[str]) -> str:
        opening, kind, name, columns, end = found.groups()
        text = shown(name, columns) if kind == "results" else TEXTS[name]() if name in TEXTS else listing(name)
        return f"{opening}\n{text}\n\n{end}"

    def number(found: re.Match[str]) -> str:
        opening, kind, name, row, column, end = found.groups()
        text = results.cell(name, row, column)
        return opening + (text if kind == "interval" else text.partition(" [")[0]) + end

    return NUMBER.sub(number, REGION.sub(region, markdown))


def listing(name: str) -> str:
    """Return the content of a file of Python as a block."""
    return f"```python\n{(DOCS.parent / name).read_text()}```"


def shown(name: str, columns: str) -> str:
    """Return the table of docs/results/NAME.csv, with these columns beside its first, and the command that made it."""
    about, found = results.read(name)
    given = columns.split(" | ")[1:]
    wanted = given.pop(0)[1:] if given and given[0].startswith("=") else ""
    places = [0, *map(found.head.index, given or found.head[1:])]
    head = [found.head[place] for place in places]
    rows = [[row[place] for place in places] for row in found.rows if wanted in row[0] and any(row[1:])]
    command = about["command"] if len(about["command"]) < 80 else "make results"
    return f"{table('|'.join(head), rows)}\n\n(`{command}`, {about['date']})"


def write() -> None:
    """Update the generated parts of all pages, and write the pictures in docs/pictures."""
    for page in (DOCS.parent / "README.md", *sorted(DOCS.rglob("*.md"))):
        page.write_text(filled(page.read_text()))
    (DOCS / "pictures").mkdir(exist_ok=True)
    with mpl.rc_context(STYLE):
        for name, draw in PICTURES.items():
            (DOCS / "pictures" / name).write_bytes(draw())


def on_page_content(content: str, **_: Any) -> str:
    r"""Convert formulas \(...\) and \[...\] of `pymdownx.arithmatex` to MathML, and make the p of V_p a subscript."""

    def math(found: re.Match[str]) -> str:
        return convert(html.unescape(found[2]), display="block" if found[1] == "div" else "inline")

    shown = re.sub(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', math, content, flags=re.DOTALL)
    pieces = re.split(r"(<pre.*?</pre>|<code.*?</code>|<[^>]+>)", shown, flags=re.DOTALL)
    return "".join(piece if piece.startswith("<") else piece.replace("V_p", "V<sub>p</sub>") for piece in pieces)


def on_post_build(config: Any, **_: Any) -> None:
    """In every page, replace the theme's script `iframe-worker/shim`, which is not on our server, by `search.js`."""
    site = Path(config.site_dir)
    for page in site.rglob("*.html"):
        root = "../" * (len(page.relative_to(site).parts) - 1)
        page.write_text(re.sub(r"https://[^\"]*/iframe-worker/shim", f"{root}search.js", page.read_text()))


def table(head: str, rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table; `head`: names of the columns, separated by `|`."""
    columns = head.split("|")
    return "\n".join("| " + " | ".join(row) + " |" for row in [columns, ["---"] * len(columns), *rows])


def environment() -> str:
    """Return the docstring of `ImpactApproachEnv` without its first paragraph."""
    return inspect.cleandoc(ImpactApproachEnv.__doc__ or "").split("\n\n", 1)[1]


def ids() -> str:
    """Return the list of the ids of environments."""
    lines = []
    for name, arguments in IDS.items():
        given = ", ".join(f"`{key}={value!r}`" for key, value in arguments.items()) or "the defaults below"
        lines.append(f"- `{name}`, {gym.make(name).observation_space.shape[0]} numbers observed: {given}")
    return "\n".join(lines)


def laws() -> str:
    """Return the table of laws of dissipation."""
    rows = [[f'`"{name}"`', f"${law.formula}$", law.source] for name, law in PUBLISHED.items()]
    fixed = '$d$ of `"exact"`, times the approach velocity, divided by `reference_velocity` (if $m = n$)'
    rows += [['`"exact"`', "the solution of the equation above", ""], ['`"fixed"`', fixed, ""]]
    return table("`dissipation`|$d$|Source", rows)


def setups() -> str:
    """Return the list of the shipped set-ups."""
    return "\n".join(f"- `{name}`: {html.escape(load_setup(name).about, quote=False)}" for name in shipped())


def materials() -> str:
    """Return the table of materials."""

    def span(of: tuple[float, float] | None) -> str:
        return " to ".join(f"{value:.3g}" for value in sorted(set(of or ())))

    rows = [[f"`{name}`", *map(span, (one.young, one.poisson, one.restitution))] for name, one in ig.MATERIALS.items()]
    return table("Material|E (Pa)|Poisson's ratio|Restitution against the same or a far stiffer material", rows)


def svg(figure: Figure) -> bytes:
    """Return a figure as SVG with a transparent background."""
    file = io.BytesIO()
    figure.savefig(file, format="svg", transparent=True, bbox_inches="tight", metadata={"Date": None})
    return file.getvalue()


def drawn(draw: Callable[[Any], None], height: float) -> bytes:
    """Return a figure of 6.4 by `height` inches as SVG; `draw` draws on its axes."""
    figure = Figure(figsize=(6.4, height))
    draw(figure.subplots())
    return svg(figure)


def contact_force(axes: Any) -> None:
    """Draw the contact force over the penetration for three restitutions."""
    for restitution, colour in ((1.0, BLUE), (0.5, ORANGE), (0.1, GREEN)):
        scene = ig.Scene(ig.Tool(0.125), ig.Object(0.25, 0.1), ig.Contact(1e5, restitution))
        trace = ig.simulate(scene, ig.Trapezoid(1.0, 8.0), trace=True).trace
        assert trace is not None
        depth = trace.tool_position - trace.object_position
        axes.plot(1e3 * depth[depth >= 0], trace.contact_force[depth >= 0], color=colour, label=f"e = {restitution:g}")
    axes.set(xlabel="penetration, mm", ylabel="contact force, N", xlim=(0, None), ylim=(0, None))
    axes.legend()


def restitution(axes: Any) -> None:
    """Draw for each law of dissipation the restitution of a contact over the nominal restitution."""
    nominal = np.linspace(0.01, 1.0, 200)
    axes.plot(nominal, nominal, color=GREY, lw=1, ls="--", label="exact")
    for law in PUBLISHED:
        axes.plot(nominal, effective_restitution(law, nominal), lw=2.5 if law == "hu-guo" else 1.2, label=law)
    axes.set(xlabel="nominal restitution", ylabel="restitution of an isolated contact", xlim=(0, 1), ylim=(0, 1))
    axes.legend()


def mechanism(axes: Any) -> None:
    """Draw the force of the paper's mechanism over the slider's position, and the positions of both stops."""
    law = ig.Bistable()
    position = np.linspace(-1.05 * law.stroke, 1.05 * law.stroke, 400)
    axes.axhline(0.0, color=GREY, lw=0.5)
    axes.plot(1e3 * position, law.force(position), color=BLUE)
    for stop, name in ((law.front_stop, "front stop"), (law.rear_stop, "rear stop")):
        axes.axvline(1e3 * stop, color=ORANGE, ls="--")
        axes.annotate(name, (1e3 * stop, -1.15), (4, 0), textcoords="offset points", color=ORANGE)
    axes.set(xlabel="position of the slider from the alignment, mm", ylabel="force on the tool, N")


def convergence(axes: Any) -> None:
    """Draw the error of the restitution over the number of force evaluations, for two forms of the equations."""
    from scipy.integrate import solve_ivp

    damping = 1.5
    exact = effective_restitution("hu-guo", 0.5)

    def in_time(_: float, state: Any) -> list[float]:
        u, rate = max(state[0], 0.0), state[1]
        return [rate, -(u**1.5) * (1.0 + damping * rate)]

    def in_the_root(_: float, state: Any) -> list[float]:
        z, rate = state
        return [rate / 2.0, -(z**4) * (1.0 + damping * rate)]

    def parts(_: float, state: Any) -> float:
        return float(state[0])

    parts.terminal, parts.direction = True, -1.0  # type: ignore[attr-defined]
    for law, colour, name in ((in_time, ORANGE, "penetration over time"), (in_the_root, BLUE, "root over s")):
        runs = [
            solve_ivp(law, (0, 20), [0.0, 1.0], "DOP853", events=parts, rtol=10.0**-n, atol=10.0**-n)
            for n in range(3, 14)
        ]
        errors = [max(abs(-run.y_events[0][0][1] - exact), 1e-16) for run in runs]
        axes.loglog([run.nfev for run in runs], errors, "o-", color=colour, label=name)
    axes.set(xlabel="evaluations of the force in one contact", ylabel="error of the restitution")
    axes.legend()


ENGINES = (  # in the pictures of engines
    "impact-gym, law in steps", "mujoco, solref, d 0.01", "newton, SemiImplicit", "drake, Lagged", "drake, SAP",
    "pybullet, stiffness", "pybullet, default", "newton, XPBD default", "newton, XPBD restitution",
    "sapien, threshold 0", "pybullet, slop and ERP 0", "rapier3d, default",
)  # fmt: skip


def engines(axes: Any, over_time: bool) -> None:
    """Draw for engines the delivered over the asked restitution, or its mean error over the processor time."""
    runs = pl.read_csv(results.FOLDER / "engines.csv", comment_prefix="#", infer_schema_length=None)
    runs = runs.filter(pl.col("case").str.starts_with("restitution-"), pl.col("delivered").is_not_null())
    error = (pl.col("delivered") - pl.col("restitution")).abs().mean().clip(1e-9).alias("error")
    for engine, marker in zip(ENGINES, "oosssDDvvvXP", strict=True):
        mine, style = runs.filter(engine=engine), {"marker": marker, "lw": 0.8, "ms": 4, "label": engine}
        if over_time:
            blows = mine.filter(pl.col("restitution").is_in([0.1, 0.5, 1.0]))
            means = blows.group_by("step").agg(pl.mean("seconds"), error)
            axes.loglog(*means.sort("step").select("seconds", "error"), **style)
        else:
            axes.plot(*mine.filter(step=2e-3).sort("restitution").select("restitution", "delivered"), ls=":", **style)
    if over_time:
        axes.set(xlabel="processor time, s per simulated s", ylabel="mean error of the restitution")
    else:
        axes.set(xlabel="restitution asked for", ylabel="restitution delivered, step 2 ms", ylim=(-0.05, 1.25))
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))


def stock(axes: Any) -> None:
    """Draw the median cost of each algorithm over the processor time of its training."""
    _, costs = results.read("stock-costs")
    for name, *medians, seconds, _ in costs.rows:
        times = [*(head.split()[0] for head in costs.head[1:-3]), seconds]
        known = [each for each in zip(times, medians, strict=True) if each[1] != "-"]
        points = [(float(time), float(median.split()[0])) for time, median in known]
        axes.plot(*zip(*points, strict=True), "o-", lw=1.2, ms=4, label=name)
    for name, style in (("paper's rule", "--"), ("tuned profile", ":")):
        level = float(results.cell("stock-others", "ImpactApproach-v0", f"{name} (m/s)"))
        axes.axhline(level, color=GREY, ls=style, label=name)
    axes.set(xlabel="processor time of the training, s", ylabel="median cost, m/s", xlim=(0, None), ylim=(0.8, 1.3))
    axes.legend(fontsize=9, ncols=2)


def work_precision(name: str) -> bytes:
    """Return a work-precision picture of the study `speed`."""
    from experiments.studies.speed import precision

    times = pl.read_csv(results.FOLDER / "speed-precision.csv", comment_prefix="#", infer_schema_length=None)
    precision.draw(figure := Figure(figsize=(9.0, 5.2), layout="constrained"), times, name)
    return svg(figure)


TEXTS = {text.__name__: text for text in (environment, ids, setups, materials, laws)}


def identified() -> bytes:
    """Return a picture (SVG) of the result of the example in how-to/identify.md."""
    page = (DOCS / "how-to/identify.md").read_text()
    names: dict[str, Any] = {}
    with contextlib.redirect_stdout(io.StringIO()):
        exec(page.split("```python\n")[1].split("```")[0], names)
    figure = names["result"].plot()
    figure.set_size_inches(9.0, 3.0)
    return svg(figure)


PICTURES: dict[str, Callable[[], bytes]] = {
    **{f"{draw.__name__}.svg": partial(drawn, draw, height)
       for draw, height in (
           (contact_force, 3.6), (convergence, 3.6), (restitution, 4.2), (mechanism, 3.4), (stock, 3.4))},
    "engines_restitution.svg": partial(drawn, partial(engines, over_time=False), 3.6),
    "engines_error.svg": partial(drawn, partial(engines, over_time=True), 3.6),
    "identified.svg": identified,
    **{f"speed_{name}.svg": partial(work_precision, f"speed_{name}")
       for name in ("approaches", "contacts", "trajectories")},
}  # fmt: skip

if __name__ == "__main__":
    write()
