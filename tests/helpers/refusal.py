import re
from copy import deepcopy

import pytest

import impact_gym as ig


def refused(call, field, *says):
    """Assert that `call` raises ValueError in one line with the field and these texts; return the error."""
    with pytest.raises(ValueError, match=re.escape(field)) as raised:
        call()
    message = str(raised.value).partition(" was raised from the environment creator")[0]  # the rest is Gymnasium's
    assert "\n" not in message
    assert not [part for part in says if part not in message], message
    return raised.value


def filled(value, things):
    """Plain data with things in place of their names, "@name"."""
    if isinstance(value, dict):
        return {name: filled(inner, things) for name, inner in value.items()}
    if isinstance(value, list):
        return [filled(inner, things) for inner in value]
    known = isinstance(value, str) and value.startswith("@") and value[1:] in things
    return filled(things[value[1:]], things) if known else value


def changed(tree, changes):
    tree = deepcopy(tree)
    for path, value in changes.items():
        *outer, last = path.split(".")
        node = tree
        for key in outer:
            node = node[int(key)] if isinstance(node, list) else node.setdefault(key, {})
        if value == "@gone":
            del node[last]
        else:
            node[last] = value
    return tree


def records(value):
    """Plain data with records of the package in place of their descriptions."""
    if isinstance(value, list):
        return [records(inner) for inner in value]
    if not isinstance(value, dict):
        return value
    fields = {name: records(inner) for name, inner in value.items()}
    return getattr(ig, fields.pop("type"))(**fields) if "type" in fields else fields
