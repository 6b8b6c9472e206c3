"""Simulated time, and the loop's two sides on it: no test that uses them waits or depends on the machine."""

import errno
import heapq
import itertools
import queue
import subprocess
import threading
from ctypes import CDLL, CFUNCTYPE, c_char, c_long, c_longlong, c_void_p, memmove, string_at
from pathlib import Path

SHIM = Path(__file__).with_name("simulated_loop.h")
SLEEP, DELIVER = CFUNCTYPE(c_longlong, c_longlong), CFUNCTYPE(None, c_void_p, c_long)
RECEIVE = CFUNCTYPE(c_long, c_void_p, c_long)


class World:
    """Time (s) that passes only in `sleep`, which makes the calls that are due, and is `overslept()` s too long."""

    def __init__(self, overslept=lambda: 0.0):
        self.now, self.overslept, self._calls, self._numbers = 0.0, overslept, [], itertools.count()

    def time(self):
        return self.now

    def call_at(self, at, call, *arguments):
        heapq.heappush(self._calls, (at, next(self._numbers), call, arguments))

    def sleep(self, seconds):
        end = self.now + seconds + self.overslept()
        while self._calls and self._calls[0][0] <= end:
            at, _, call, arguments = heapq.heappop(self._calls)
            self.now = max(self.now, at)
            call(*arguments)
        self.now = max(self.now, end)


class Network:
    """The arm's socket: `inbox` has (packet, peer) that have arrived; `controller(packet)` gets readings."""

    def __init__(self, controller):
        self.inbox, self.controller = [], controller

    def recvfrom(self, _size):
        if not self.inbox:
            raise BlockingIOError
        return self.inbox.pop(0)

    def sendto(self, packet, _peer):
        self.controller(packet)


class Program:
    """loop.c in this process. It receives what is in `inbox`, packets or numbers of errors, and sends into `sent`."""

    def __init__(self, source):
        library = source.with_suffix(".so")
        flags = ["-std=c99", "-O1", "-w", "-shared", "-fPIC", "-include", str(SHIM)]
        subprocess.run(["cc", *flags, str(source), "-lm", "-o", str(library)], check=True)
        self._library, self.inbox, self.sent = CDLL(str(library)), [], []

    def _receive(self, where, room):
        packet = self.inbox.pop(0) if self.inbox else errno.EAGAIN
        if isinstance(packet, int):
            return -packet
        memmove(where, packet, min(len(packet), room))
        return min(len(packet), room)

    def run(self, wake, priority=0):
        """Run it to its end; return code, output, warnings. `wake(until)` gives the end of a sleep, None: until."""
        self.inbox.clear()
        self.sent.clear()
        sleep = SLEEP(lambda until: until if (end := wake(until)) is None else end)
        deliver = DELIVER(lambda where, size: self.sent.append(string_at(where, size)))
        code = self._library.loop_run(sleep, RECEIVE(self._receive), deliver, priority)
        return code, *((c_char * 1000).in_dll(self._library, name).value.decode() for name in ("printed", "warned"))

    def run_with(self, network):
        """Run it until the arm of `network` says the end, a period after each of its packets; return its results."""
        asleep, woken, results = queue.SimpleQueue(), queue.SimpleQueue(), []

        def wake(until):
            asleep.put(until)
            woken.get()

        def work():
            results.append(self.run(wake))
            asleep.put(None)

        def follow(*packets):
            self.inbox += packets
            woken.put(None)
            asleep.get()
            network.inbox += [(packet, "loop") for packet in self.sent]
            self.sent.clear()

        network.controller = follow
        threading.Thread(target=work, daemon=True).start()
        asleep.get()
        follow()  # it greets
        return results
