"""Generate `numbers.pxi`: structures of the compiled program, with fields from `impact_gym.quantities`."""

from collections.abc import Iterable, Iterator

from impact_gym.quantities import EPISODE, MORE_SENSORS, QUANTITIES, SCENARIO, SENSORS, SET_UP, Quantity

STRUCTS = {part: f"{part.capitalize()}Numbers" for part in ("coupling", "robot", "operator")}
STRUCTS["range_sensor"] = "RangeSensorNumbers"
STRUCTS |= dict.fromkeys(("uplink", "downlink"), "ChannelNumbers")
NOTICE = '"""Written by setup.py from the table in `impact_gym/quantities.py`: edit that."""'


def text() -> str:
    """Return the text of `numbers.pxi`."""
    inner = {part: [row for row in SET_UP if row.id.startswith(f"{part}.")] for part in STRUCTS}
    drawn = [*SCENARIO, *EPISODE, *(row for row in SET_UP if "." not in row.id)]
    sensed = [*SENSORS, *(row for row in QUANTITIES.values() if row.from_flange), *MORE_SENSORS]
    generated = {row.id: row.draw for row in EPISODE if row.draw}
    places = [(f"{name.upper()}_UNIFORM", draw.place) for name, draw in generated.items() if draw.normal]
    places += [("NOISE_SEED_UNIFORM", generated["noise_seed"].place)]
    places += [("UNIFORMS", 1 + max(place for _, place in places))]
    lines = [NOTICE, "", "cpdef enum:  # places among the uniform numbers from the generator, and their count"]
    lines += [f"    {name} = {place}" for name, place in places]
    for part, rows in inner.items():
        lines += ["", "", f"cdef struct {STRUCTS[part]}:", *_fields(rows)] if part != "downlink" else []
    lines += ["", "", "cdef struct Record:  # numbers of an episode and of its set-up; nan: to draw"]
    lines += [*_fields(drawn), *(f"    {STRUCTS[part]} {part}" for part in inner)]
    lines += ["", "", "cdef struct Sensors:  # sensor values, and true values for a critic"]
    return "\n".join([*lines, *_fields(sensed, ", from the flange"), ""])


def _fields(rows: Iterable[Quantity], from_flange: str = "") -> Iterator[str]:
    for row in rows:
        where = from_flange if row.from_flange else ""
        yield f"    double {row.id.rpartition('.')[2]}  # {row.unit}, {row.words}{where}"
