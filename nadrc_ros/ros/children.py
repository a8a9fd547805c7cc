"""Processes that a command starts, and that do not outlive it."""

from __future__ import annotations

from collections.abc import Sequence
import ctypes
import os
import signal
import subprocess
import sys
from typing import Any

# Tells a process which one started it.
_PARENT = 'NADRC_ROS_PARENT'
_PR_SET_PDEATHSIG = 1


def start_child(command: Sequence[str], **more: Any) -> subprocess.Popen[Any]:
    """
    Start a process in a session of its own: Ctrl-C reaches only the one that started it.

    It has to call :func:`end_with_parent`, which is part of starting ROS.
    """
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        start_new_session=True,
        env=os.environ | {_PARENT: str(os.getpid())},
        **more,
    )


def end_with_parent() -> None:
    """
    Let this process be told to stop (SIGTERM) when the one that started it is killed.

    On Linux, and only where :func:`start_child` started it.
    """
    parent = int(os.environ.pop(_PARENT, 0))
    if not parent or sys.platform != 'linux':
        return
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:  # it died before that
        raise SystemExit('the command that started this process has ended')
