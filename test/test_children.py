"""What a command starts ends with it, also when it is killed."""

from __future__ import annotations

from pathlib import Path
import signal
import subprocess
import sys
import time

import nadrc_ros
import pytest

PACKAGE = Path(nadrc_ros.__file__).parent
CHILD = """
import time
from nadrc_ros.ros.children import end_with_parent
end_with_parent()
print('bound', flush=True)
time.sleep(60.0)
"""
PARENT = f"""
import subprocess, sys, time
from nadrc_ros.ros.children import start_child
child = start_child([sys.executable, '-c', {CHILD!r}], stdout=subprocess.PIPE)
child.stdout.readline()
print(child.pid, flush=True)
time.sleep(60.0)
"""


@pytest.mark.skipif(sys.platform != 'linux', reason='only Linux tells a process of that')
def test_a_child_of_a_killed_command_ends() -> None:
    with subprocess.Popen([sys.executable, '-c', PARENT], stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = Path('/proc', parent.stdout.readline().decode().strip(), 'status')
        assert child.exists()
        parent.send_signal(signal.SIGKILL)
    end = time.monotonic() + 10.0
    while child.exists() and '(zombie)' not in child.read_text() and time.monotonic() < end:
        time.sleep(0.01)
    assert not child.exists() or '(zombie)' in child.read_text()


def test_every_process_that_outlasts_a_call_is_such_a_child() -> None:
    starting = {path.name for path in PACKAGE.rglob('*.py') if 'Popen(' in path.read_text()}
    assert starting == {'children.py'}
