"""
A bad network link in user space: frames from one interface are sent to the other, some of them.

    python bad_link.py SEED INTERFACE INTERFACE

Each line on stdin, "delay spread loss" (s, s, fraction), is the state of the link from then on; it
is answered with the time at which it took effect, and how late at most a frame was sent until then
[s]. A frame takes ``delay`` +- ``spread`` from its arrival, so frames overtake each other; a loss
of 1 is a cut, which takes also what is under way.
"""

from __future__ import annotations

from contextlib import suppress
import heapq
from itertools import count
import os
import random
import selectors
import socket
import struct
import sys
import time

ETH_P_ALL = 3
SOL_PACKET = 263
PACKET_VNET_HDR = 15
SO_TIMESTAMPNS = 35
FRAME = 1 << 17


def open_interface(name: str) -> socket.socket:
    """
    Return a socket for all frames of an interface.

    Each comes with a header that says what was left to the network card: checksums, cutting into
    packets. It is sent on with the frame; without it, the receiver would drop the frame.
    """
    opened = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(ETH_P_ALL))
    opened.setsockopt(SOL_PACKET, PACKET_VNET_HDR, 1)
    opened.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    opened.bind((name, ETH_P_ALL))
    opened.setblocking(False)
    return opened


def receive(interface: socket.socket) -> tuple[bytes, bool, float]:
    """Return a frame, whether it goes out here, and when the kernel got it [s]."""
    frame, [(_, _, stamp)], _, (_, _, kind, *_) = interface.recvmsg(FRAME, 64)
    seconds, nanoseconds = struct.unpack('ll', stamp)
    return frame, kind == socket.PACKET_OUTGOING, seconds + nanoseconds * 1e-9


def forward(rng: random.Random, interfaces: list[socket.socket]) -> None:
    """Forward until stdin ends."""
    delay = spread = loss = late = 0.0
    order = count()
    under_way: list[tuple[float, int, socket.socket, bytes]] = []
    selector = selectors.DefaultSelector()
    selector.register(sys.stdin, selectors.EVENT_READ)
    for interface, other in zip(interfaces, reversed(interfaces)):
        selector.register(interface, selectors.EVENT_READ, other)
    while True:
        now = time.time()
        while under_way and under_way[0][0] <= now:
            due, _, out, frame = heapq.heappop(under_way)
            late = max(late, now - due)
            try:
                out.send(frame)
            except OSError:  # a full queue loses frames too
                continue
        wait = under_way[0][0] - now if under_way else None
        ready = selector.select(wait)
        for key, _ in ready:
            if not isinstance(key.fileobj, socket.socket):
                if len(ready) > 1:
                    continue  # frames that waited here go first, by the old state
                line = sys.stdin.readline()
                if not line:
                    return
                delay, spread, loss = map(float, line.split())
                if loss >= 1.0:
                    under_way.clear()
                print(time.time(), late, flush=True)
                late = 0.0
                continue
            frame, is_outgoing, arrival = receive(key.fileobj)
            if is_outgoing or rng.random() < loss:
                continue
            due = arrival + delay + spread * rng.uniform(-1.0, 1.0)
            heapq.heappush(under_way, (due, next(order), key.data, frame))


if __name__ == '__main__':
    with suppress(PermissionError):  # a link does not wait for a processor
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    forward(random.Random(int(sys.argv[1])), [open_interface(name) for name in sys.argv[2:4]])
