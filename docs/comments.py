"""An extension of the reference: the comment after a field, its unit and meaning, becomes its docstring."""

import re
from typing import Any

import griffe


class Comments(griffe.Extension):
    """Use the comment at the end of an attribute's line as its docstring if it has none; MkDocs loads this by path."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give an attribute a docstring."""
        if attr.docstring is None and attr.lineno is not None and attr.lines:
            found = re.search(r"\s# (?!type:|noqa)(.+)$", attr.lines[-1])
            if found:
                attr.docstring = griffe.Docstring(found[1], parent=attr, lineno=attr.lineno)
