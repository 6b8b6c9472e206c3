"""Extension for the API reference: an attribute without docstring gets the comment on its line as docstring."""

import re
from typing import Any

import griffe


class Comments(griffe.Extension):
    """The extension of griffe; mkdocs.yml has the path of this file."""

    def on_attribute(self, *, attr: griffe.Attribute, **_: Any) -> None:
        """Set a missing docstring to the comment at the end of the attribute's last line."""
        if attr.docstring is None and attr.lineno is not None and attr.lines:
            found = re.search(r"\s# (?!type:|noqa)(.+)$", attr.lines[-1])
            if found:
                attr.docstring = griffe.Docstring(found[1], parent=attr, lineno=attr.lineno)
