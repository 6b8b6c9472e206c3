"""Extension for the reference: comments as docstrings of attributes, and tables in the docstrings of environments."""

import inspect
import re
from pkgutil import resolve_name
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

    def on_class(self, *, cls: griffe.Class, **_: Any) -> None:
        """Take the docstring of the imported class: it has tables in place of words such as OBSERVATION_TABLE."""
        if cls.docstring is not None and "_TABLE" in cls.docstring.value:
            cls.docstring.value = inspect.cleandoc(resolve_name(cls.path).__doc__)
