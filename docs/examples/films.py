"""Make the films of docs/films: controllers with the same object, one below the other, slow around each touch.

The object is the middle of the ranges of the set-ups. Each row ends with the picture of its own last instant.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from agents import load_baseline, load_setup
from experiments.lab.player.films import clock, play
from impact_gym.render import Renderer

OBJECT = {"object_mass": 0.5, "contact_stiffness": 3.16e4, "restitution": 0.55, "distance": 0.25}  # kg, N/m^1.5, -, m
WEIGHT = 1.2  # m/s per s, at which the tuned profile arrives as late as the paper's rule
SECONDS, RATE, AFTER = 6.0, 20, 0.25  # s of motion; pictures per s; s shown after the last touch
HAND = {"friction": 0.3, "uplink": {"delay": 0.1}, "downlink": {"delay": 0.1},
        "operator": {"type": "Trapezoid", "speed": 0.4}}  # fmt: skip
RULE = ("the paper's rule", "linear-blind", "paper-trapezoid")
PROFILE = ("a tuned profile", "linear-blind", "blind-profile")
FILMS = {  # what each row is called, its set-up and its controller
    "rule-and-profile": (RULE, PROFILE),
    "distance-estimated": (RULE, PROFILE, ("a profile over the estimate", "linear-ranged", "ranged-profile")),
    "couplings": (("fixed to the arm", "rigid-blind", RULE[2]), ("spring and damper", *RULE[1:]),
                  ("bistable mechanism", "bistable-blind", RULE[2])),
    "hand-and-brake": (("a hand alone", "teleop-rigid", "operator-alone"),
                       ("the same hand, brake at the arm", "teleop-rigid", "local-brake")),
}  # fmt: skip


def pictures(rows: tuple[tuple[str, str, str], ...]) -> Iterator[Image.Image]:
    """Yield the pictures of a film, the last of them for two seconds."""
    runs = []
    for _, setup, name in rows:
        task = load_setup(setup).environment
        task |= HAND if "operator" in task else {}
        task["time_weight"] = WEIGHT
        runs.append(
            play(load_baseline(name, WEIGHT).for_task(load_setup(setup).task.changed(task)), 0, 0, OBJECT, task)
        )
    end = min(max(run.now for run in runs), max(run.touches[0] for run in runs) + AFTER)
    starts, factors = np.array([*clock(runs, end), [end, 1.0]]).T
    lasts = np.append(0.0, np.cumsum(np.diff(starts) * factors[:-1]))  # s of the film at each of `starts`
    shown, renderer = np.linspace(0.0, lasts[-1], round(SECONDS * RATE)), Renderer("rgb_array")

    def picture(times: list[float], factor: float) -> Image.Image:
        drawn = []
        for (label, *_), run, time in zip(rows, runs, times, strict=True):
            canvas = renderer.draw(run, min(time, run.now), factor)
            canvas.text(label, (480.0, 86.0), 36, anchor="center")
            drawn.append(canvas.pixels())
        return Image.fromarray(np.vstack(drawn)).resize((560, 315 * len(rows)), Image.Resampling.LANCZOS)

    pace = SECONDS / lasts[-1]
    for at, time in zip(shown, np.interp(shown, lasts, starts), strict=True):
        place = min(int(np.searchsorted(lasts, at, side="right")) - 1, len(factors) - 2)
        yield picture([time] * len(rows), factors[place] * pace)
    yield from [picture([run.now for run in runs], 1.0)] * (2 * RATE)


for name in sys.argv[1:] or FILMS:
    first, *others = pictures(FILMS[name])
    file = Path("docs/films", f"{name}.webp")
    first.save(file, save_all=True, append_images=others, duration=1000 // RATE, loop=0, quality=40, method=4)
    print(file)
