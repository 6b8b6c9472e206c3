"""What the page that is played takes: `PYTHONPATH=. python tests/play/bars.py` starts it, plays and floods it.

Prints time to the first answer, key to picture, the clock alone and under a flood, and memory. Figures, no verdicts:
timings are never a test's assertion here.
"""

import asyncio
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "helpers"))

from browsers import chromium
from playing import flood, lateness, play, served

LOOK = """() => {
  const flange = document.querySelector('#picture .igw-flange'), channel = new MessageChannel();
  let pressed = null, before = 0, shown = null;
  window.measured = [];
  channel.port1.onmessage = () => { window.measured.push(performance.now() - shown); };
  addEventListener('keydown', (event) => {
    if (event.repeat) return;
    pressed = event.timeStamp;
    before = Number(flange.getAttribute('x'));
  }, true);
  new MutationObserver(() => {
    if (pressed === null || Math.abs(Number(flange.getAttribute('x')) - before) < 0.3) return;
    shown = pressed;
    pressed = null;
    channel.port2.postMessage(0);
  }).observe(flange, {attributes: true, attributeFilter: ['x']});
}"""


def key_to_picture(page, tries):
    """Press and release keys while the arm rests; return the times until the picture has moved, ms."""
    found = []
    for value, control in (("0", "#delay"), ("0", "#jitter")):
        page.locator(control).fill(value)
    for _ in range(tries):
        page.click("#go")
        page.wait_for_selector("body.playing")
        page.wait_for_timeout(300)
        page.evaluate(LOOK)
        for key in ("ArrowRight", "ArrowLeft") * 8:
            page.keyboard.down(key)
            page.wait_for_timeout(60)
            page.keyboard.up(key)
            page.wait_for_timeout(310 + 23 * np.random.default_rng(len(found)).random())
        found += page.evaluate("() => window.measured")
        page.keyboard.press(" ")
        page.wait_for_selector("body:not(.playing)", timeout=15000)
    return found


def percentiles(values):
    """Return median, 99th percentile and maximum in words."""
    middle, high = np.percentile(values, [50, 99])
    return f"median {middle:.2f}, p99 {high:.2f}, most {np.max(values):.2f} ms of {len(values)}"


def main():
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        begun = time.monotonic()
        with served(Path(folder) / "keys") as server:
            page = browser.new_page()
            page.goto(server.address)
            page.wait_for_selector("#go:not([disabled])")
            print(f"from the command to a page that answers keys: {time.monotonic() - begun:.2f} s")
            page.wait_for_selector(".igw-panel")
            print("key to picture:", percentiles(key_to_picture(page, 8)))
            print("its clock:", percentiles(lateness(server.tries())))
            page.close()
        for name, loud in (("alone", False), ("under a flood", True)):
            with served(Path(folder) / name.replace(" ", "-")) as server, server.connect() as player:
                play(player)
                before = server.memory()
                line = [sys.executable, __file__, server.address]
                clients = subprocess.Popen(line, stdout=subprocess.PIPE, text=True) if loud else None
                for _ in range(8):
                    play(player, assist="brake")
                print(f"clock {name}:", percentiles(lateness(server.tries()[1:])))
                print(f"memory {name}: {before / 1e6:.0f} MB before, {server.memory() / 1e6:.0f} MB after")
                if clients:
                    clients.terminate()
                    print(server.end()[1])


if __name__ == "__main__":
    if len(sys.argv) > 1:
        asyncio.run(flood(sys.argv[1], 40.0))
    else:
        main()
