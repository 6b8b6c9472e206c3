"""Extension for the API reference: a field without docstring gets the comment on its line as docstring."""

import re
from typing import Any

import griffe


class Comments(griffe.Extension):
    """Extension of griffe, which mkdocs.yml names by the path of this file."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Give an attribute without docstring the comment at the end of its last line as docstring."""
        if attr.docstring is None and attr.lineno is not None and attr.lines:
            found = re.search(r"\s# (?!type:|noqa)(.+)$", attr.lines[-1])
            if found:
                attr.docstring = griffe.Docstring(found[1], parent=attr, lineno=attr.lineno)
