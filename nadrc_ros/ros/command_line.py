"""What is on the command line of a node beside the arguments of ROS."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Sequence
from itertools import pairwise
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
