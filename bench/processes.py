"""What the benches of the nodes share: processes, on a graph of their own, and what they use."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import os
from pathlib import Path
import signal
import subprocess
import sys
from time import monotonic

import attrs

QUIET = ('--log-level', 'error')
CONTROLLER = 'nadrc_ros.nodes.controller'
BARE = 'bench.bare_node'
TICK = 1.0 / os.sysconf('SC_CLK_TCK')


@attrs.frozen
class Process:
    """A process, and when it was started [s]."""

    start: float
    pid: int

    @property
    def cpu(self) -> float:
        """Return the processor time of all its threads until now [s]."""
        fields = Path(f'/proc/{self.pid}/stat').read_text(encoding='ascii').rpartition(')')[2]
        return TICK * sum(map(int, fields.split()[11:13]))


def environment() -> dict[str, str]:
    """Return one in which Python keeps what it compiled, as users have it."""
    return {k: v for k, v in os.environ.items() if k != 'PYTHONDONTWRITEBYTECODE'}


@contextmanager
def process(
    module: str, *arguments: str, namespace: str = '', **parameters: object
) -> Iterator[Process]:
    """Run a module with nodes in it in a process of its own, until the block ends."""
    given = [word for name, value in parameters.items() for word in ('-p', f'{name}:={value}')]
    inside = ['-r', f'__ns:={namespace}'] if namespace else []
    ros = ['--ros-args', *QUIET, *inside, *given]
    start = monotonic()
    running = subprocess.Popen([sys.executable, '-m', module, *arguments, *ros], env=environment())
    try:
        yield Process(start, running.pid)
    finally:
        running.send_signal(signal.SIGINT)
        running.wait()
