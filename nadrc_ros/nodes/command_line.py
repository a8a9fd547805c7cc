"""
The executables of this package and their command line.

Nothing of ROS is imported before a node is asked for: where ROS is missing, one sentence says so.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from importlib import import_module
from itertools import pairwise
import sys
from typing import NoReturn

MORE = """
All parameters, with ranges and units: docs/parameters.md, or `ros2 param describe` while it runs.

examples:
"""


class NodeParser(ArgumentParser):
    """
    Parses what is on the command line of a node beside the arguments of ROS.

    Parameters
    ----------
    executable, description
        Of the node.
    examples : str
        Command lines, one a line.

    """

    def __init__(self, executable: str, description: str, examples: str) -> None:
        super().__init__(
            prog=executable,
            description=description,
            epilog=MORE + examples.strip('\n'),
            formatter_class=RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )

    def parse(self, command: Sequence[str]) -> Namespace:
        """Parse; exit after showing the help, or with 2 for what is for nobody."""
        from rclpy.utilities import remove_ros_args

        for before, rule in pairwise(command):
            if ':=' in rule and (not before.startswith('-') or before in {'--', '--ros-args'}):
                self.error(f'{rule} has no -p or -r before it')
        try:
            rest = remove_ros_args(list(command))[1:]
        except RuntimeError:  # ROS will not start with these, and says why
            rest = []
        return self.parse_args(rest)

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        super().error(
            f'{message}\nROS takes what comes after --ros-args: `-p name:=value` is a parameter, '
            '`-r topic:=other` a remapping'
        )


def controller() -> int:
    """Run the controller node."""
    return _run('controller')


def plant() -> int:
    """Run the plant node."""
    return _run('plant')


def reference() -> int:
    """Run the reference node."""
    return _run('reference')


def recorder() -> int:
    """Run the recorder node."""
    return _run('recorder')


def _run(node: str) -> int:
    try:
        module = import_module(f'nadrc_ros.nodes.{node}')
    except ImportError as error:
        print(
            f'the {node} needs ROS 2 Jazzy, which is not here ({error}): source its setup.bash, '
            'or let `make demo` in the source tree install it in .venv (Linux on x86-64)',
            file=sys.stderr,
        )
        return 1
    code: int = module.main()
    return code
