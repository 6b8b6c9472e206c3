"""What every page of an experiment has to be."""

import re
from html.parser import HTMLParser


def text_of_a_page_that_stands_on_its_own(folder, figures):
    """Check that the page in a folder has its figures inside and leads to files that are there; return its text."""
    text = (folder / "index.html").read_text()
    assert len(re.findall("data:image/svg", text)) == figures
    assert not re.search(r"""(src|href)=["'](https?:|//)""", text)
    for file in re.findall('href="([^"#]+)"', text):
        assert (folder / file).is_file()
    return as_plain_text_has_it(text)


def as_plain_text_has_it(text):
    """Return HTML with its subscripts and powers as they were before they were typeset."""
    return re.sub(r"<sup>([^<]+)</sup>", r"^\1", re.sub(r"<sub>(\w+)</sub>", r"_\1", text))


def controls(text):
    """Return tag, accessible name and target of all that the keyboard reaches or that is announced as a part."""
    parser = _Controls()
    parser.feed(text)
    return [(tag, " ".join(name).strip(), target) for tag, name, target in parser.controls]


class _Controls(HTMLParser):
    """Collects names: a label's or an element's own text, what its pictures are called, or what it says of itself."""

    TAGS = ("button", "select", "input", "textarea", "summary", "slow-motion")
    ROLES = ("img", "region", "tab", "tabpanel", "tablist")  # not those inside a chart, which is one picture
    VOID = ("br", "hr", "img", "input", "link", "meta")

    def __init__(self):
        super().__init__()
        self.controls, self.open = [], []  # open: tags, each with the name that its text goes to

    def handle_starttag(self, tag, attributes):
        given, name = dict(attributes), None
        if tag == "label":
            name = []
        elif tag in self.TAGS or "href" in given or "tabindex" in given or given.get("role") in self.ROLES:
            labels = [name for each, name in self.open if each == "label"]
            name = labels[-1] if labels else []
            self.controls.append((tag, name, given.get("href")))
            name.append(given.get("aria-label") or "")
        if tag == "img":
            self.handle_data(given.get("alt") or "")
        if tag not in self.VOID:
            self.open.append((tag, name))

    def handle_endtag(self, tag):
        while self.open and self.open.pop()[0] != tag:
            pass

    def handle_data(self, text):
        for tag, name in self.open:
            if name is not None and tag not in ("select", "slow-motion"):
                name.append(text.strip())
