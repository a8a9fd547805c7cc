"""Real-time priority: for every thread where it is permitted, and said so in one line if not."""

from __future__ import annotations

import os
from pathlib import Path
import signal
import subprocess
import sys
from typing import Any

from probe import Probe, Processes

NOBODY = 65534
# As a user that nothing is permitted to, whoever runs the tests.
UNPRIVILEGED = f"""
import os, resource
from nadrc_ros.ros.realtime import become_realtime
if os.geteuid() == 0:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
    os.setuid({NOBODY})
print(*become_realtime())
"""


def scheduling(probe: Probe, node: str) -> str:
    probe.wait_until(lambda: probe.said(node))
    return probe.said(node)[-1][2]['scheduling']


def test_real_time_priority_is_for_every_thread_or_it_is_said_why_not(
    probe: Probe, start: Processes
) -> None:
    process = start('controller', realtime=True)
    told = scheduling(probe, 'controller')
    threads = [int(task.name) for task in Path(f'/proc/{process.popen.pid}/task').iterdir()]
    obtained = {os.sched_getscheduler(thread) for thread in threads}
    assert len(threads) > 3
    if 'SCHED_FIFO 50 on' in told:
        assert obtained == {os.SCHED_FIFO}
    else:
        assert obtained == {os.SCHED_OTHER}
        assert 'allow' in told and 'rtprio 50' in told
    lines = [line for line in process.said.splitlines() if 'realtime:' in line]
    assert len(lines) == 1 and told in lines[0]
    process.signal(signal.SIGINT)
    assert probe.end_of(process) == 0


def test_nobody_asks_for_priority_unless_told_to(probe: Probe, start: Processes) -> None:
    parameters: dict[str, Any] = {'directory': str(start.directory / 'runs')}
    for node in ('controller', 'recorder'):
        process = start(node, **(parameters if node == 'recorder' else {}))
        assert scheduling(probe, node) == 'not asked for'
        assert 'realtime' not in process.said


def test_without_permission_one_line_says_what_to_allow() -> None:
    command = [sys.executable, '-c', UNPRIVILEGED]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (line,) = done.stdout.splitlines()
    assert line.startswith('False no SCHED_FIFO (Operation not permitted), memory not locked')
    assert 'allow rtprio 50 memlock unlimited for this user (/etc/security/limits.conf' in line
