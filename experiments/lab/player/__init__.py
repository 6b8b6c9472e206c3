"""Watch contestants side by side in the same scenario: films for a page that opens from disk.

`choose` picks the scenarios, `films` plays them and keeps what the eye needs, `fragment` is the part of the page, which
has `style` and `script` once.
"""

from experiments.lab.player.films import choose, films
from experiments.lab.player.page import fragment, script, style

__all__ = ["choose", "films", "fragment", "script", "style"]
