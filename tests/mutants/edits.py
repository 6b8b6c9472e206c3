"""A sample of small edits: of Python by Cosmic Ray's operators, of Cython token by token.

The key of an edit is a hash of its file, of the code of its line (without a comment) and of the change. The sample has
first the keys in `sample.json`, then the smallest. So a change of a file replaces only the edits of the changed lines.
"""

import io
import json
import tokenize
import zlib
from collections import Counter
from dataclasses import dataclass
from difflib import SequenceMatcher
from functools import partial
from pathlib import Path

from cosmic_ray.ast import Visitor, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator

from tests.mutants.trial import ROOT

SHARE, MOST = 0.55, 12  # edits of a file, over the square root of the number of possible ones; at most
PYTHON = (
    *(f"ReplaceBinaryOperator_{pair}" for pair in ("Add_Sub", "Sub_Add", "Mul_Div", "Div_Mul", "Pow_Mul")),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Lt_GtE", "LtE_Gt", "Gt_LtE", "GtE_Lt", "Eq_NotEq", "NotEq_Eq")),
    *(f"ReplaceComparisonOperator_{pair}" for pair in ("Is_IsNot", "IsNot_Is")),
    *("ReplaceAndWithOr", "ReplaceOrWithAnd", "ReplaceTrueWithFalse", "ReplaceFalseWithTrue"),
    *("ReplaceUnaryOperator_Delete_USub", "ReplaceUnaryOperator_Delete_Not", "ReplaceBreakWithContinue"),
    *("AddNot", "NumberReplacer", "ZeroIterationForLoop", "RemoveDecorator"),
)
"""Operators of Cosmic Ray; the others change types or repeat an edit."""
SWAPS = {"+": "-", "-": "+", "*": "/", "/": "*", "<": ">=", ">=": "<", ">": "<=", "<=": ">", "==": "!=", "!=": "=="}
WORDS = {"and": "or", "or": "and", "not": "", "min": "max", "max": "min", "fabs": "", "+=": "-=", "-=": "+="}
PERCENT = 1.01  # factor of a number in Cython
SAMPLE = json.loads((Path(__file__).parent / "sample.json").read_text("utf-8"))  # keys by file


@dataclass(frozen=True)
class Edit:
    """Lines of a file from `line` (1 is the first) and their replacement; without a file there is no edit."""

    file: str = ""
    line: int = 0
    before: str = ""
    after: str = ""


def mutants(where, left_out):
    """A sample of the edits of files in these places."""
    files = {str(file.relative_to(ROOT)) for name in where for file in (ROOT / name).rglob("*.p[yx]*")}
    files |= {name for name in where if name.endswith(".py")}
    for file in sorted(file for file in files - set(left_out) if file.endswith((".py", ".pyx", ".pxi"))):
        source = (ROOT / file).read_text("utf-8")
        possible = (python_edits if file.endswith(".py") else cython_edits)(file, source)
        known = {key: place for place, key in enumerate(SAMPLE.get(file, ()))}
        ranked = sorted(possible, key=lambda key: (known.get(key, len(known)), key))
        yield from (possible[key]() for key in ranked[: min(MOST, round(SHARE * len(possible) ** 0.5))])


def code(text):
    """Text without a comment, and without white space at both ends."""
    return text.split("  #")[0].strip()


def keyed(file, edits):
    """Functions that return an edit, by key; `edits` are tuples of the line, a word for the change and the function."""
    by_key, alike = {}, Counter()
    for line, word, edit in edits:
        what = f"{file}|{code(word)}|{code(line)}"
        by_key[f"{zlib.crc32(f'{what}|{alike[what]}'.encode()):08x}"] = edit
        alike[what] += 1
    return by_key


class Found(Visitor):
    """Collects the lines of all places of each operator, in the order of Cosmic Ray."""

    def __init__(self):
        self.rows = {name: [] for name in PYTHON}

    def visit(self, node):
        for name in PYTHON:
            self.rows[name] += [start[0] for (start, _) in get_operator(f"core/{name}")().mutation_positions(node)]
        return node


def python_edits(file, source):
    """All edits of a Python file by Cosmic Ray's operators, by key."""
    found, lines = Found(), source.split("\n")
    found.walk(get_ast(source))
    return keyed(file, (
        (lines[row - 1], name, partial(python_edit, file, source, name, place))
        for name, rows in found.rows.items() for place, row in enumerate(rows)
    ))  # fmt: skip


def python_edit(file, source, name, place):
    """The edit of an operator at the place with this number."""
    old, new = source.split("\n"), mutate_code(source, get_operator(f"core/{name}")(), place).split("\n")
    blocks = [block for block in SequenceMatcher(None, old, new, False).get_opcodes() if block[0] != "equal"]
    first, last = blocks[0][1], blocks[-1][2]
    return Edit(file, first + 1, "\n".join(old[first:last]), "\n".join(new[blocks[0][3] : blocks[-1][4]]))


def cython_edits(file, source):
    """Edits of a Cython file by key: operators and words become their opposites, numbers change by one per cent."""
    lines, edits = source.split("\n"), []
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        (row, start), (_, end), line = token.start, token.end, lines[token.start[0] - 1]
        if line.lstrip().startswith(("cimport", "include", "ctypedef", "from", "import")):
            continue
        spaced = line[start - 1 : start] == " " == line[end : end + 1]  # a product, not a pointer
        instead = WORDS.get(token.string, SWAPS.get(token.string) if spaced else None)
        if token.type == tokenize.NUMBER and set(token.string) & set(".e"):
            instead = repr(float(token.string) * PERCENT or 0.01)
        elif token.type == tokenize.NUMBER:
            instead = str(int(token.string, 0) + 1)
        if instead is not None:
            after = line[:start] + instead + line[end:]
            edits.append((line, after.strip(), partial(Edit, file, row, line, after)))
    return keyed(file, edits)
