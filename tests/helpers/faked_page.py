"""The page of `impact-gym play` in a browser, beside a server that the test plays."""

import json
from pathlib import Path

from browser_pages import opened
from play_client import Page

from experiments.play.server import HEADERS, Site

SLIDES = {"You": 0.1, "Your hand, brake on": 0.0009}
FILM = json.dumps({"html": "<p></p>", "slides": SLIDES, "words": "The hand."}), "application/json"


class Faked:
    """The page, with a server that the test plays (faked_page.js), and a clock that only `run` moves."""

    def __init__(self, browser, world, stopped=True, **options):
        self.setup, self.files = str(world.setup), {**Site(world.session, "token", 1).files, "film": FILM}
        self.page, self.problems = opened(browser, "about:blank", own=("http://127.0.0.1:1/", "data:"), **options)
        if stopped:
            self.page.clock.install(time=0)
            self.page.clock.pause_at(1000)
        self.page.add_init_script(path=Path(__file__).with_name("faked_page.js"))
        self.page.route("**/*", self.answer)
        self.page.goto("http://127.0.0.1:1/token/")
        self.before = [self.page.inner_text(f"#{part}") for part in ("state", "go")]
        self.hear(*Page(world).messages)
        self.run, self.text = self.page.clock.run_for, self.page.inner_text

    def answer(self, route):
        body, kind = self.files[route.request.url.rpartition("/token/")[2].partition("/")[0]]
        route.fulfill(body=body, headers=HEADERS | {"Content-Type": f"{kind}; charset=utf-8"})

    def ask(self, what, *given):
        return self.page.evaluate(f"given => fake.{what}", given[0] if len(given) == 1 else [*given])

    def hear(self, *messages):
        self.page.evaluate("given => fake.hear(given)", [*messages])

    def wait(self, condition):
        """Wait until a condition holds; `wait_for_function` would break the page's security policy."""
        for _ in range(1000):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(20)
        raise TimeoutError(condition)

    def said(self, word):
        """The values with this word of the messages since the last call."""
        return [message[word] for message in self.ask("said()") if word in message]

    def begin(self):
        self.hear({"kind": "began", "setup": self.setup, "radius": 0.03})

    def frame(self, start, end, dt=0.016, touched=False):
        self.hear({"kind": "frame", "n": 0, "t": 1.0, "dt": dt, "touched": touched, "from": start, "to": end})
        self.run(32)  # the first picture may be drawn at once, the second 16 ms later

    def end(self, times=1, **result):
        entry = {"name": "try 1", "setup": self.setup, "assist": "none", "delay": 0.2, "marks": [], "missed": 0.0,
                 "slide": 0.02, "done_time": 2.0, "object_velocity": 0.3} | result  # fmt: skip
        self.hear(*[{"kind": "ended", "entry": entry}] * times)
