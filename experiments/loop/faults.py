"""A wire between controller and arm that fails when it is asked to: packets are passed on, or not as they were."""

import select
import socket
import struct
import threading
import time
from collections.abc import Callable, Mapping

from experiments.loop.arm import COMMAND

FAULT_AT = 0.12  # s of the first approach, before any object is met
Change = Callable[[bytes], bytes]


def _with(place: int, value: float, add: bool = False) -> Change:
    """Return what puts `value` in a number of a packet, or adds it: 1 is the stamp (s), 2 the velocity (m/s)."""

    def change(packet: bytes) -> bytes:
        magic, *numbers = COMMAND.unpack(packet)
        numbers[place] = numbers[place] + value if add else value
        return COMMAND.pack(magic, *numbers)

    return change


CHANGES: Mapping[str, Change] = {
    "drop": lambda packet: b"",
    "delay": lambda packet: packet,  # by DELAY
    "wrong size": lambda packet: packet[:-1],
    "NaN": _with(2, float("nan")),
    "stale stamp": _with(1, -0.5, add=True),
    "future stamp": _with(1, 0.5, add=True),
    "too fast": _with(2, 50.0),
}
DELAY = 0.15  # s


class Wire(threading.Thread):
    """Passes packets between the controller, which sends to `port`, and the arm, until it is closed."""

    def __init__(self, arm: int, change: Change | None, delay: float, act: Callable[[], None] = lambda: None) -> None:
        """Make a wire.

        Args:
            arm: port of the arm.
            change: of the controller's packets from the fault on; what is empty is not sent.
            delay: of these packets, s.
            act: called when the fault comes.
        """
        super().__init__(daemon=True)
        self.front, self.back = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
        self.front.bind(("127.0.0.1", 0))
        self.back.connect(("127.0.0.1", arm))
        self.port = self.front.getsockname()[1]
        self.change, self.delay, self.act = change, delay, act
        self.failed_at = 0.0  # s of the monotonic clock, 0: not yet
        self.closed = threading.Event()

    def run(self) -> None:
        """Pass packets on."""
        peer, waiting = None, list[tuple[float, bytes]]()
        while not self.closed.is_set():
            ready, _, _ = select.select([self.front, self.back], [], [], 1e-3)
            now = time.monotonic()
            try:
                if self.back in ready:
                    packet = self.back.recv(4096)
                    if not self.failed_at and struct.unpack_from("5d", packet, 8)[4] >= FAULT_AT:
                        self.failed_at = now
                        self.act()
                    if peer:
                        self.front.sendto(packet, peer)
                if self.front in ready:
                    packet, peer = self.front.recvfrom(4096)
                    changed = self.change(packet) if self.failed_at and self.change else packet
                    waiting.append((now + (self.delay if self.failed_at else 0.0), changed))
                while waiting and waiting[0][0] <= now:
                    if packet := waiting.pop(0)[1]:
                        self.back.send(packet)
            except ConnectionRefusedError:  # a side is dead
                continue
