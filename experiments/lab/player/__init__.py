"""Watch contestants side by side in the same scenario: films for a page that opens from disk.

`choose` selects scenarios, `films` plays them and thins their traces, `fragment` is the HTML of one set of films; a
page needs `style` and `script` once.
"""

from experiments.lab.player.films import choose, films
from experiments.lab.player.page import fragment, script, style

__all__ = ["choose", "films", "fragment", "script", "style"]
