"""What runs here: versions that a record of a run should name."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
import os
import platform

import rclpy

PACKAGES = ('nadrc_ros', 'rclpy')


def versions() -> dict[str, str]:
    """Return the versions of this package and of what it runs on, those that are known."""
    found = {package: _version(package) for package in PACKAGES}
    found |= {
        'python': platform.python_version(),
        'ROS distribution': os.environ.get('ROS_DISTRO', ''),
        'middleware': rclpy.get_rmw_implementation_identifier(),
        'platform': f'{platform.system()} {platform.machine()}',
    }
    return {name: value for name, value in found.items() if value}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # run from a source tree
        return ''
