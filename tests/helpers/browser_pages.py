"""Pages in Chromium, driven by Playwright, and the checks that hold for every page of an experiment."""


def opened(browser, file, width=1280, own=("file:", "data:"), **options):
    """Return a page at a file or an address, and its messages, errors, and requests to others than `own` (starts)."""
    page, problems = browser.new_context(viewport={"width": width, "height": 900}, **options).new_page(), []
    page.on("console", lambda message: problems.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: problems.append(str(error)))
    for kind in ("request", "websocket"):
        page.on(kind, lambda asked: asked.url.startswith(own) or problems.append(asked.url))
    page.goto(file if isinstance(file, str) else file.as_uri())
    return page, problems


def stands_on_its_own(browser, file, width=1280):
    """Check what holds for every page; return it in a window of this width, with all folds open.

    Nothing comes from other servers, no script fails, links have targets, pictures and controls names; all fits.
    """
    page, problems = opened(browser, file, width)
    page.evaluate("document.querySelectorAll('details').forEach(fold => { fold.open = true; })")
    page.wait_for_load_state("networkidle")
    for link in page.evaluate("[...document.querySelectorAll('a[href]')].map(link => link.getAttribute('href'))"):
        name, _, key = link.partition("#")
        assert (file.parent / name).exists(), link
        assert name or page.evaluate("key => document.getElementById(key) !== null", key), link
    parts = "a[href], button, select, input, summary, img, slow-motion, [role=img]:not(svg *), [role=region]"
    named = "part => (part.ariaLabel || part.alt || part.labels?.[0]?.textContent || part.textContent).trim()"
    assert page.evaluate(f"[...document.querySelectorAll('{parts}')].filter(part => !({named})(part)).length") == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert problems == []
    return page
