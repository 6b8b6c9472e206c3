"""Simulated time, and the loop's two sides on it: no test that uses them waits or depends on the machine."""

import ctypes
import errno
import heapq
import itertools
import subprocess
import threading
from pathlib import Path

SHIM = Path(__file__).with_name("simulated_loop.h")


class World:
    """Time (s) that passes only while someone sleeps; meanwhile the calls that are due are made.

    `overslept()` is the time (s) by which the next sleep is too long.
    """

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
    """The arm's socket: `inbox` has (packet, peer) that have arrived, or errors; `controller(packet)` gets readings."""

    def __init__(self, controller):
        self.inbox, self.controller = [], controller

    def recvfrom(self, _size):
        found = self.inbox.pop(0) if self.inbox else BlockingIOError()
        if isinstance(found, OSError):
            raise found
        return found

    def sendto(self, packet, _peer):
        self.controller(packet)


class Program:
    """loop.c in this process: `run(wake)` runs it; `wake(until)` is called in each of its sleeps.

    `until` and the time that `wake` returns (None: `until`) are in ns. The program receives what is in `inbox`, packets
    or numbers of errors; what it sends comes into `sent`.
    """

    def __init__(self, source):
        library = source.with_suffix(".so")
        flags = ["-std=c99", "-O1", "-w", "-shared", "-fPIC", "-include", str(SHIM)]
        subprocess.run(["cc", *flags, str(source), "-lm", "-o", str(library)], check=True)
        self._library, self.inbox, self.sent = ctypes.CDLL(str(library)), [], []

    def _calls(self, wake):
        """The functions that the program calls, by their names."""

        @ctypes.CFUNCTYPE(ctypes.c_longlong, ctypes.c_longlong)
        def sleep_until(until):
            ended = wake(until)
            return until if ended is None else ended

        @ctypes.CFUNCTYPE(ctypes.c_long, ctypes.c_void_p, ctypes.c_long)
        def receive(where, room):
            packet = self.inbox.pop(0) if self.inbox else errno.EAGAIN
            if isinstance(packet, int):
                return -packet
            ctypes.memmove(where, packet, min(len(packet), room))
            return min(len(packet), room)

        @ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_long)
        def deliver(where, size):
            self.sent.append(ctypes.string_at(where, size))

        return {"sleep_until": sleep_until, "receive": receive, "deliver": deliver}

    def run(self, wake, port="1", priority=0):
        """Run it to its end from time 0; return its exit code, and what it printed and warned of."""
        library, calls = self._library, self._calls(wake)
        self.inbox.clear()
        self.sent.clear()
        for name, call in calls.items():
            ctypes.c_void_p.in_dll(library, name).value = ctypes.cast(call, ctypes.c_void_p).value
        ctypes.c_int.in_dll(library, "priority_result").value = priority
        library.loop_begin()
        code = library.loop_main(2, (ctypes.c_char_p * 2)(b"loop", port.encode()))
        return code, *((ctypes.c_char * 1000).in_dll(library, name).value.decode() for name in ("printed", "warned"))

    def run_in(self, world, network):
        """Run it as a part of a world whose time is 0, connected to the arm's socket; return a list of its results."""
        ours, its, results = threading.Semaphore(0), threading.Semaphore(0), []

        def wake(until):
            world.call_at(1e-9 * until, resume)
            ours.release()
            its.acquire()

        def resume():
            its.release()
            ours.acquire()
            network.inbox += [(packet, "loop") for packet in self.sent]
            self.sent.clear()

        def work():
            results.append(self.run(wake))
            ours.release()

        network.controller = self.inbox.append
        threading.Thread(target=work, daemon=True).start()
        ours.acquire()
        return results
