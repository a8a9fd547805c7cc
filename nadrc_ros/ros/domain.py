"""A ROS domain for this process alone, on this machine alone."""

from __future__ import annotations

from contextlib import suppress
import fcntl
import os
from pathlib import Path
import tempfile
from typing import IO

from nadrc_ros.adrc.errors import UserError

# Above 101 the ports of a domain can be those that Linux gives to others.
DOMAINS = range(1, 101)
# Open files hold the locks: of the domain that this process took, once it did.
_taken: dict[int, IO[str]] = {}


def private_domain(*, keep: bool = False) -> int:
    """
    Give this process, and those it starts, a ROS domain that no other process has.

    It sets ``ROS_DOMAIN_ID`` and ``ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST`` in the environment,
    so it has to come before rclpy is initialised. A locked file stands for each domain and frees
    it with the process. Asked again, it gives the same domain.

    Parameters
    ----------
    keep
        Whether a domain that the environment already names is used as it is.

    Raises
    ------
    UserError
        When all domains are taken.

    """
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
    if keep and 'ROS_DOMAIN_ID' in os.environ:
        return int(os.environ['ROS_DOMAIN_ID'])
    domain = next(iter(_taken), 0) or _take()
    os.environ['ROS_DOMAIN_ID'] = str(domain)
    return domain


def _take() -> int:
    for domain in DOMAINS:
        path = Path(tempfile.gettempdir(), f'nadrc_ros_domain_{domain}.lock')
        with suppress(OSError):  # another user's: who may read it may lock it too
            path.touch()
        try:
            lock = path.open()
        except OSError:
            continue
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            lock.close()
            continue
        _taken[domain] = lock
        return domain
    raise UserError(f'all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are taken')
