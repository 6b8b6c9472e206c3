"""Files of tries (a JSON file for each try), and an operator that replays tries."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from experiments.play.assistance import NAMES, PERIOD, RANGES
from experiments.play.tries import RESULTS, Try
from impact_gym.support.files import parsed, write_file
from impact_gym.support.validation import choice, number, numbers, one_of

SLOWEST = 16.0  # largest `Try.slow`
MAX_TEXT, MAX_NUMBER = 4096, 2.0**64  # limits: characters of set-up and marks together; absolute value of a number
FORMAT = "impact_gym try 3"
SPARE = 3  # control periods that each recording lasts beyond the horizon of an episode


def from_text(text: str) -> Try:
    """Return the try in a text; ValueError, TypeError, LookupError, AttributeError: another format or a wrong value."""
    content = json.loads(text, parse_float=_finite, parse_constant=_finite, parse_int=lambda text: int(_finite(text)))
    if content.pop("format", None) != FORMAT:
        raise ValueError(f"its format is not {FORMAT!r}")
    this = Try(**content)
    for name, sample in vars(Try("", "", 0, {})).items():
        one_of(name, getattr(this, name), type(sample))
    texts = "".join([this.setup, *this.marks])
    if len(texts) > MAX_TEXT or not texts.isprintable() or "<" in texts:
        raise ValueError(f"setup and marks must have at most {MAX_TEXT} printable characters in total, without <")
    choice("assist", this.assist, list(NAMES))
    choice("type of its operator", this.operator["type"], ["Replay"])
    number("slow", this.slow, "(times)", at_least=1.0, at_most=SLOWEST)
    number("uplink.delay", this.record["uplink.delay"], "s", at_least=0.0, at_most=0.5 * RANGES["delay"][2])
    for action in this.actions:
        numbers("action", action, "-")
    if {*this.result} != {*RESULTS}:
        raise ValueError(f"its results are not {', '.join(RESULTS)}")
    for name, value in this.result.items():
        number(name, value, "-", at_least=-1.0, at_most=1e3 if name.endswith("time") else 1e9)
    return this


def _finite(text: str) -> float:
    return number("each number", float(text), "-", at_least=-MAX_NUMBER, at_most=MAX_NUMBER)


def write(path: Path, this: Try) -> Path:
    """Write a try atomically and return its path."""
    return write_file(path, json.dumps({"format": FORMAT, **asdict(this)}, allow_nan=False))


def read(path: Path) -> Try:
    """Return the try in a file; ValueError: the file is no try of this version."""
    return parsed(path, "a try", from_text)


def folder_of(folder: Path) -> Iterator[tuple[Path, Try]]:
    """Return paths and tries of a folder, sorted by the files' names."""
    return ((path, read(path)) for path in sorted(folder.glob("*.json")))


def of_persons(folder: Path, marked: bool = False) -> list[Try]:
    """Read the tries in a folder; `marked`: also marked ones. ValueError: none, bad file, several environments."""
    every = [this for _, this in folder_of(folder)]
    found = [this for this in every if marked or not this.marks]
    if not found:
        allowed = "" if marked else f" to use: {len(every)} marked tries need --include-marked"
        raise ValueError(f"{folder} has no try of a person{allowed}")
    if any(this.environment != found[0].environment for this in found):
        raise ValueError(f"{folder} has tries of several set-ups or couplings: move each kind to its own folder")
    return found


def operator_of(found: Sequence[Try]) -> dict[str, Any]:
    """Return the arguments of an operator `Replay` that draws one of the tries for each episode."""
    ticks = round(found[0].environment["horizon"] / PERIOD) + SPARE
    times, velocities = list[float](), list[float]()
    for place, this in enumerate(found):
        given = this.operator["velocity"][: ticks - 1]
        begin = place * (ticks * PERIOD)
        times += [begin + k * PERIOD for k in (*range(len(given)), ticks - 1)]
        velocities += [*given, given[-1]]
    drawn = {"length": ticks * PERIOD, "recording": [0, len(found)]}
    return {"type": "Replay", "time": times, "velocity": velocities} | drawn
