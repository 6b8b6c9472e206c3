"""The scenarios of a report: a frozen set by name or file, or a user's own ranges and tool."""

import json
from pathlib import Path
from typing import Any

from agents.evaluate.play import pairs
from agents.setups.evaluation import RESERVED
from agents.setups.keys import within
from impact_gym.files import parsed
from impact_gym.task import Task, evaluation_sets
from impact_gym.validation import number, whole


def scenarios_from(source: str, count: int | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return scenarios as JSON and changes of the environment: from a frozen set's name or file, or from a JSON file.

    The JSON file says `{"ranges": {...}, "seed": s, "count": n, "environment": {...}}`, all of which may be left out;
    the environment holds arguments of `gym.make`, such as `tool_mass` or `coupling`.

    Raises:
        ValueError: no such set or file, or something in it is unknown or out of range; says what.
    """
    path = Path(source)
    if path.suffix == ".json":
        content = parsed(path, "scenarios, JSON", json.loads)
        keys = {"ranges", "seed", "count", "environment"}
        if not isinstance(content, dict) or set(content) - keys:
            raise ValueError(f"{path} must be a JSON object with some of {sorted(keys)}, got {str(content)[:200]}")
        environment = content.get("environment", {})
        with within(f"{path}: ranges"):
            ranges = pairs(content.get("ranges", "test"))
        count = whole("count", count or content.get("count", 1000), at_least=2)
        seed = whole("seed", content.get("seed", 2_000_000), at_least=0)
        with within(str(path)):
            Task.of("environment", environment)
        taken = sorted(set(environment) & {"scenario", *RESERVED})
        if taken:
            raise ValueError(f"{path}: environment must leave out {taken}: ranges and the report see to that")
        return {"ranges": ranges, "seed": seed, "count": count}, environment
    frozen = evaluation_sets.load(source)
    count = whole("scenarios", count or frozen.count, at_least=2)
    number("scenarios", count, "(no unit)", at_most=frozen.count)
    if (evaluation_sets.SHIPPED / f"{source}.csv").is_file():
        return {"set": source, "count": count}, {}
    table = {name: values[:count].tolist() for name, values in frozen.scenario.items()}
    return {"table": table, "seed": frozen.seed, "count": count}, {}
