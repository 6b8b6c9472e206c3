"""A user's set-up with its own arm, a short training and a short report."""

from pathlib import Path

TEXT = Path(__file__).with_suffix(".toml").read_text("utf-8")


def change(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
