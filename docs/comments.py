"""The reference shows what stands behind a field as a comment: its unit and meaning. MkDocs loads this by its path."""

import re
from typing import Any

import griffe


class Comments(griffe.Extension):
    """Take the comment at the end of an attribute's line as its docstring, where it has none."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give an attribute of ours a docstring."""
        if attr.docstring is None and attr.lineno is not None and attr.lines:
            found = re.search(r"\s# (?!type:|noqa)(.+)$", attr.lines[-1])
            if found:
                attr.docstring = griffe.Docstring(found[1], parent=attr, lineno=attr.lineno)
