"""What every page of an experiment has to be."""

import re


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
