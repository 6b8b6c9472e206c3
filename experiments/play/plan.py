"""The plan of a study within persons: what is compared, how often and in which order; and where each person stands."""

import secrets
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.setups import load_setup
from experiments.play import tries
from experiments.play.assistance import LONGEST, MOST_JITTER, NAMES, STIFFNESS, playable, usual
from experiments.play.live import Asked
from impact_gym.files import parsed
from impact_gym.validation import choice, number, one_of, whole

OUTCOMES = ("slide at equal done_time",)
WHOLE = {"seed": 0, "practice": 0, "blocks": 1, "tries": 1}
KEYS = ("title", "setup", "outcome", "smallest", "alpha", "power", "seed", "practice", "blocks", "tries", "consent",
        "conditions")  # fmt: skip


@dataclass(frozen=True)
class Plan:
    """A study: two conditions, the second against the first."""

    title: str
    setup: str
    outcome: str  # the primary one
    smallest: float  # m, the difference worth finding
    conditions: Mapping[
        str, Mapping[str, Any]
    ]  # by name: assist, delay (s, there and back), jitter (s), stiffness (N/m)
    consent: str
    seed: int = 0
    practice: int = 20  # tries before the first block
    blocks: int = 2  # of each condition, for each person
    tries: int = 10  # of a block
    alpha: float = 0.05
    power: float = 0.9

    def order(self, person: int) -> list[str]:
        """Return the condition of each block of the `person`-th person: each pair of blocks both, in either order.

        Which comes first changes from pair to pair; of two persons one has the other's opposite.
        """
        first, second = self.conditions
        flip = np.random.default_rng((self.seed, person // 2)).integers(2) + person
        pairs = ([first, second] if (flip + block) % 2 == 0 else [second, first] for block in range(self.blocks))
        return [condition for pair in pairs for condition in pair]

    def schedule(self, person: int) -> list[dict[str, Any]]:
        """Return what each try of a person is: condition, block (0: practice), and the seed of its scenario.

        Practice goes through both conditions in turn. Scenarios are the same in both blocks of a pair, in other orders.
        """
        rng = np.random.default_rng((self.seed, 1 + person))
        seeds = rng.integers(2**31, size=(self.blocks, self.tries))
        plan = [{"condition": [*self.conditions][k % 2], "block": 0, "seed": int(rng.integers(2**31))}
                for k in range(self.practice)]  # fmt: skip
        for block, condition in enumerate(self.order(person)):
            plan += [{"condition": condition, "block": 1 + block, "seed": int(seed)}
                     for seed in rng.permutation(seeds[block // 2])]  # fmt: skip
        return plan


def read(path: Path) -> Plan:
    """Return the plan in a TOML file.

    Raises:
        ValueError: something is missing or wrong in it: names file, key and what is allowed.
    """
    content = parsed(path, "TOML", tomllib.loads)
    try:
        return _plan(content)
    except ValueError as problem:
        raise ValueError(f"{path}: {problem}") from None


def _plan(content: dict[str, Any]) -> Plan:
    for key in content:
        choice("key", key, KEYS)
    if content.get("outcome") not in OUTCOMES:
        raise ValueError(
            f"outcome must be fixed before anybody plays: one of {OUTCOMES}, got {content.get('outcome')!r}"
        )
    for key in ("title", "setup", "consent"):
        one_of(key, content.get(key), str)
    conditions = content.get("conditions")
    if not isinstance(conditions, dict) or len(conditions) != 2:
        raise ValueError(f"conditions must be two tables [conditions.NAME], got {conditions!r:.80}")
    sliders = usual(playable(content["setup"]))
    most = {"delay": (0.0, 2.0 * LONGEST), "jitter": (0.0, MOST_JITTER), "stiffness": STIFFNESS}
    for name, condition in conditions.items():
        one_of(f"conditions.{name}", condition, dict)
        choice(f"conditions.{name}.assist", condition.get("assist"), list(NAMES))
        for key in condition.keys() - {"assist"}:
            choice(f"conditions.{name}: key", key, ["assist", *sliders])
            low, high = most[key]
            number(f"conditions.{name}.{key}", condition[key], "s or N/m", at_least=low, at_most=high)
    share: Any = {"above": 0.0, "at_most": 0.999}
    given: dict[str, Any] = {
        name: whole(name, content[name], least) for name, least in WHOLE.items() if name in content
    }
    given |= {name: number(name, content[name], "(no unit)", **share) for name in ("alpha", "power") if name in content}
    return Plan(
        content["title"], content["setup"], content["outcome"],
        number("smallest", content.get("smallest"), "m", above=0.0), conditions, content["consent"],
        **given,
    )  # fmt: skip


class Study:
    """Where the persons of a plan stand, by the tries in a folder."""

    def __init__(self, plan: Plan, folder: Path) -> None:
        self.plan = plan
        self.done: dict[int, int] = {}  # tries of each person, in the order in which they came
        for _, this in tries.folder_of(folder):
            self.enter(this.study)
        self.person: int | None = None

    def enter(self, try_of: Mapping[str, Any]) -> None:
        """Count a try, by its `study`; one that was interrupted is not asked for again."""
        person = try_of["person"]
        self.done[person] = max(self.done.get(person, 0), 1 + try_of["number"])

    def agree(self) -> None:
        """A person has read the text and agrees: one who was interrupted goes on, else a new one gets a number."""
        unfinished = [person for person, count in self.done.items() if count < self.length]
        person = unfinished[-1] if unfinished else secrets.randbelow(10**6)
        self.person = person
        self.done.setdefault(person, 0)

    @property
    def length(self) -> int:
        """Tries of a person."""
        return self.plan.practice + 2 * self.plan.blocks * self.plan.tries

    def asked(self) -> Asked:
        """Return the next try of the person.

        Raises:
            ValueError: nobody has agreed, or the person is done.
        """
        if self.person is None or self.done[self.person] >= self.length:
            raise ValueError("a try of a study begins when a person has agreed and is not done")
        return self.asked_of(self.person, self.done[self.person])

    def asked_of(self, person: int, number: int) -> Asked:
        """Return a try of a person: which counts from 0."""
        slot = self.plan.schedule([*self.done].index(person))[number]
        condition = dict(self.plan.conditions[slot["condition"]])
        assist = condition.pop("assist")
        about = {"person": person, "number": number, "condition": slot["condition"], "block": slot["block"]}
        chosen = usual(load_setup(self.plan.setup)) | {name: float(value) for name, value in condition.items()}
        return Asked(self.plan.setup, assist, chosen, slot["seed"], study=about)

    def now(self) -> dict[str, Any]:
        """Return what the page of a person says: nothing of conditions."""
        done = self.done.get(self.person, 0) if self.person is not None else 0
        return {
            "title": self.plan.title, "consent": self.plan.consent, "person": self.person, "done": done,
            "practice": self.plan.practice, "length": self.length,
        }  # fmt: skip
