"""What a loop would send to a recorder, sample by sample."""

from __future__ import annotations

from collections.abc import Callable
import json
from pathlib import Path
import time
from typing import Any

from nadrc_ros.nodes.recorder import RecorderNode
from nadrc_ros.records.recording import read_samples, SUMMARY
from probe import Probe

PERIOD = 0.02
_TRIES = 8
INPUTS = 'reference measurement command output'
TOPICS = ('reference', 'measurement', 'command', 'plant/output')


class Feed:
    """Publishes what a loop would, sample by sample, to a recorder beside the probe."""

    def __init__(self, make: Callable[..., Probe], directory: Path, **settings: Any) -> None:
        values = {'inputs': INPUTS, 'directory': str(directory), **settings}
        self.probe = make(parameters={'recorder': values})
        self.recorder = self.probe.add(RecorderNode())
        self.send = {topic: self.probe.publisher(topic) for topic in TOPICS}
        self.intake = self.recorder.intake
        self._greeted = 0
        self.probe.wait_until(self._heard)
        # What is still on its way would be in the run that is to come.
        heard = self.intake.losses.values()
        self.probe.wait_until(lambda: all(topic.newest == self._greeted for topic in heard))
        assert self.probe.trigger('recorder/reset').success
        self.k = 0
        self._before = self.intake.losses['command'].newest
        self._next = time.monotonic()
        self.slowest = 0.0  # how long it took to send the signals of one sample [s]

    def _heard(self) -> bool:
        """Send something on every topic; whether the recorder has heard them all."""
        self._greeted += 1
        for send in self.send.values():
            send(0.0)
        return not self.intake.unheard()

    def sample(self, *, silent: bool = False) -> None:
        """Send the next sample a period after the last one, or all of it but the measurement."""
        self._next = max(self._next + PERIOD, time.monotonic())
        self.probe.wait_until(lambda: time.monotonic() >= self._next)
        k = self.k = self.k + 1
        values = {'reference': 1.0, 'measurement': 0.1 * k, 'plant/output': 0.1 * k + 0.5}
        values['command'] = 0.01 * k
        begin = time.monotonic()
        for topic, value in values.items():
            if not (silent and topic == 'measurement'):
                self.send[topic](value)
        self.slowest = max(self.slowest, time.monotonic() - begin)
        heard = self.intake.losses['command']
        self.probe.wait_until(lambda: heard.newest >= self._before + k)

    def samples(self, count: int) -> None:
        for _ in range(count):
            self.sample()

    def rows(self, count: int) -> dict[str, list[float]]:
        """Return the columns once there are so many rows in the file."""
        folder = self.recorder.folder.path
        self.probe.wait_until(lambda: len(read_samples(folder)['time']) >= count)
        return read_samples(folder)

    def summary(self) -> dict[str, Any]:
        """End the run and return its summary."""
        folder = self.recorder.folder.path
        assert self.probe.trigger('recorder/reset').success
        content: dict[str, Any] = json.loads((folder / SUMMARY).read_text())
        return content


def fed_steadily(make: Callable[..., Probe], directory: Path, count: int, **settings: Any) -> Feed:
    """
    Feed samples to a recorder, anew if this process stood still while it sent one.

    An output that is sent late stands alone between two measurements, in a row of its own.
    """
    feed = Feed(make, directory, **settings)
    feed.samples(count)
    for _ in range(_TRIES):
        if feed.slowest < PERIOD / 4:
            break
        feed.probe.close()
        feed = Feed(make, directory, **settings)
        feed.samples(count)
    return feed
