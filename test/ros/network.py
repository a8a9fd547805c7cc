"""Two network namespaces joined by nothing but a bad link; see bad_link.py."""

from __future__ import annotations

from contextlib import suppress
import json
import os
from pathlib import Path
import shutil
import subprocess
import sys
from typing import NamedTuple

from probe import NodeProcess, Processes

# Where `ip` is even when PATH, as that of a user or of cron, does not say so.
IP = shutil.which('ip', path=os.pathsep.join([os.environ.get('PATH', ''), '/usr/sbin', '/sbin']))
FORWARDER = Path(__file__).with_name('bad_link.py')
OBSERVER = Path(__file__).with_name('observer.py')


class Sample(NamedTuple):
    """A value as it was published; ``time`` is that of its publication [s]."""

    value: float
    number: int
    time: float


class Report(NamedTuple):
    """What a node said on /diagnostics, and when that was heard [s]."""

    level: int
    values: dict[str, str]
    time: float


class Refused(RuntimeError):
    """This machine does not let us make networks."""


def _ip(*arguments: str) -> None:
    if IP is None:
        raise Refused('no `ip` (Debian, Ubuntu: apt install iproute2)')
    done = subprocess.run([IP, *arguments], check=False, capture_output=True, text=True)
    if done.returncode:
        raise Refused(f'ip {" ".join(arguments)}: {done.stderr.strip()}')


class Link:
    """
    Two network namespaces, ``ends``, and the link between them: perfect, until ``set``.

    Raises
    ------
    Refused
        Where namespaces, interfaces or raw sockets are not permitted.

    """

    def __init__(self, seed: int) -> None:
        *self.ends, self._middle = self._names = [
            f'nadrc-{os.getpid()}-{name}' for name in ('near', 'far', 'middle')
        ]
        self._forwarder: subprocess.Popen[str] | None = None
        self.late = 0.0
        try:
            self._make()
            self._start(seed)
        except BaseException:
            self.close()
            raise

    def _make(self) -> None:
        for name in self._names:
            _ip('netns', 'add', name)
            _ip('-n', name, 'link', 'set', 'lo', 'up')
        for i, name in enumerate(self.ends):
            peer = ['peer', 'name', f'end{i}', 'netns', self._middle]
            _ip('-n', name, 'link', 'add', 'bad0', 'type', 'veth', *peer)
            _ip('-n', name, 'addr', 'add', f'10.77.0.{i + 1}/24', 'dev', 'bad0')
            _ip('-n', name, 'link', 'set', 'bad0', 'up')
            _ip('-n', self._middle, 'link', 'set', f'end{i}', 'up')
            _ip('-n', name, 'route', 'add', '224.0.0.0/4', 'dev', 'bad0')

    def _start(self, seed: int) -> None:
        self._forwarder = subprocess.Popen(
            self.inside(self._middle, sys.executable, str(FORWARDER), str(seed), 'end0', 'end1'),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.set()

    def set(self, delay: float = 0.0, spread: float = 0.0, loss: float = 0.0) -> float:
        """
        Delay each frame by ``delay`` +- ``spread`` [s] or lose it; return since when.

        ``late`` is then how much later than due the latest frame before that was sent [s].
        """
        assert self._forwarder and self._forwarder.stdin and self._forwarder.stdout
        with suppress(BrokenPipeError):
            self._forwarder.stdin.write(f'{delay} {spread} {loss}\n')
            self._forwarder.stdin.flush()
        if answer := self._forwarder.stdout.readline():
            since, self.late = map(float, answer.split())
            return since
        raise Refused(self._forwarder.communicate()[1].strip().rpartition('\n')[2])

    def inside(self, name: str, *command: str) -> list[str]:
        """Return the command that runs ``command`` in one of the namespaces."""
        return [str(IP), 'netns', 'exec', name, *command]

    def close(self) -> None:
        """Remove everything, also what was only half made."""
        if self._forwarder is not None:
            self._forwarder.kill()
            self._forwarder.communicate()
        for name in self._names:
            with suppress(Refused):
                _ip('netns', 'del', name)


def refusal() -> str:
    """Return why this machine cannot make a link, empty where it can."""
    try:
        Link(seed=0).close()
    except Refused as error:
        return str(error)
    return ''


class Inside(Processes):
    """Starts nodes in one of the network namespaces."""

    def __init__(self, link: Link, end: str, namespace: str, directory: Path) -> None:
        super().__init__(namespace, directory)
        self._link, self._end = link, end

    def run(self, name: str, *arguments: str) -> NodeProcess:
        command = self._link.inside(self._end, sys.executable, *arguments)
        process = NodeProcess(command, self.directory / f'{self._end}-{name}.log')
        self._all.append(process)
        return process

    def observe(self, *topics: str) -> Observation:
        """Start an observer and return what it hears."""
        file = self.directory / f'{self._end}.jsonl'
        ros = ('--ros-args', '-r', f'__ns:={self.namespace}')
        self.run('observer', str(OBSERVER), str(file), *topics, *ros)
        return Observation(file)


class Observation:
    """What an observer has written so far."""

    def __init__(self, path: Path) -> None:
        self.samples: dict[str, list[Sample]] = {}
        self.reports: dict[str, list[Report]] = {}
        self._path = path
        self._read = 0

    def of(self, topic: str) -> list[Sample]:
        self._update()
        return self.samples.setdefault(topic, [])

    def said(self, node: str) -> list[Report]:
        self._update()
        return self.reports.setdefault(node, [])

    def _update(self) -> None:
        """Read on; what is not a whole line yet is left for later."""
        if not self._path.exists():
            return
        with self._path.open('rb') as file:
            file.seek(self._read)
            text, newline, _ = file.read().rpartition(b'\n')
        self._read += len(text) + len(newline)
        for line in text.splitlines():
            topic, *entry = json.loads(line)
            if topic == '/diagnostics':
                name, *report = entry
                self.reports.setdefault(name.rpartition('/')[2], []).append(Report(*report))
            else:
                self.samples.setdefault(topic, []).append(Sample(*entry))
