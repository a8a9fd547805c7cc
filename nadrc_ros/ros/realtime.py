"""Real-time priority and locked memory for the whole process, where that is permitted."""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
import resource

# That of the controller manager of ros2_control.
_PRIORITY = 50
_MCL_CURRENT, _MCL_FUTURE = 1, 2
_CAP_IPC_LOCK = 14
_LIMITS = '(/etc/security/limits.conf, or LimitRTPRIO and LimitMEMLOCK of systemd)'


def become_realtime() -> tuple[bool, str]:
    """
    Ask for SCHED_FIFO for all threads and for locked memory; nothing is raised.

    To be called when the threads of the middleware are there: they carry the samples, and the
    main thread alone would wait for them. Threads that these start have the priority too.

    Returns
    -------
    tuple
        Whether both were obtained, and one line that says what was, or why not and what to do.

    """
    answers = _raise_priority(), _lock_memory()
    wanted = ' '.join(need for _, need in answers if need)
    said = ', '.join(said for said, _ in answers)
    return not wanted, f'{said}; allow {wanted} for this user {_LIMITS}' if wanted else said


def _raise_priority() -> tuple[str, str]:
    threads = [int(task.name) for task in Path('/proc/self/task').iterdir()]
    try:
        for thread in threads:
            try:
                os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(_PRIORITY))
            except ProcessLookupError:  # it has ended by now
                continue
    except OSError as error:
        return f'no SCHED_FIFO ({error.strerror})', f'rtprio {_PRIORITY}'
    return f'SCHED_FIFO {_PRIORITY} on {len(threads)} threads', ''


def _lock_memory() -> tuple[str, str]:
    """Lock memory, unless there is a limit: an allocation beyond it would fail later."""
    hard = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    if hard == resource.RLIM_INFINITY:
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (hard, hard))
    elif not _unlimited():
        return f'memory not locked (limited to {hard // 1024} kB)', 'memlock unlimited'
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE):
        return f'memory not locked ({os.strerror(ctypes.get_errno())})', 'memlock unlimited'
    return 'memory locked', ''


def _unlimited() -> bool:
    """Tell whether this process has the capability that no limit of locked memory holds for."""
    status = Path('/proc/self/status').read_text(encoding='utf-8')
    capabilities = int(status.partition('CapEff:')[2].split()[0], 16)
    return bool(capabilities >> _CAP_IPC_LOCK & 1)
