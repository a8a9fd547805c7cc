"""
The executables of this package.

Nothing of ROS is imported before a node is asked for: where ROS is missing, one sentence says so.
"""

from __future__ import annotations

from functools import partial
from importlib import import_module
import sys


def _run(node: str) -> int:
    try:
        module = import_module(f'nadrc_ros.nodes.{node}')
    except ImportError as error:
        if (error.name or '').startswith('nadrc_ros'):
            raise
        print(
            f'error: the {node} needs ROS 2 Jazzy or Kilted, which is not here ({error}): source '
            'its setup.bash, or let `make demo` in the source tree install it in .venv (Linux '
            'on x86-64)',
            file=sys.stderr,
        )
        return 1
    code: int = module.main()
    return code


controller, plant, reference, recorder = (
    partial(_run, node) for node in ('controller', 'plant', 'reference', 'recorder')
)
