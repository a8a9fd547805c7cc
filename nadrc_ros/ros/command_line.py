"""The command line of a node's executable, beside the arguments of ROS."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Mapping, Sequence
from itertools import pairwise
import os
from shlex import split
import sys
from typing import Any, NoReturn

import attrs
from nadrc_ros.adrc.errors import near_to
from nadrc_ros.adrc.fields import Declared
from nadrc_ros.terminal import columns, command_line, wrapped

# Help that no terminal shows is as wide.
_WIDTH = 100
_ROS_ARGUMENTS = '[--ros-args -p PARAMETER:=VALUE ... -r TOPIC:=OTHER ...]'
_ALL_PARAMETERS = (
    'All parameters, with ranges and units: docs/parameters.md, or `ros2 param describe` while it '
    'runs.'
)
_RULE_FLAGS = ('-p', '--param', '-r', '--remap')


@attrs.frozen(kw_only=True)
class About:
    """
    What the help of an executable says.

    Attributes
    ----------
    purpose
        One sentence.
    topics, parameters, examples
        What each topic carries, the five parameters that matter first, and command lines.
    options
        What the executable takes beside the arguments of ROS.
    more
        Paragraphs after these.

    """

    purpose: str
    topics: Mapping[str, str]
    parameters: Mapping[str, Declared]
    examples: Sequence[str]
    options: Mapping[str, str] = attrs.field(factory=dict)
    more: Sequence[str] = ()


class NodeParser(ArgumentParser):
    """Parses what is on the command line of a node beside the arguments of ROS."""

    def __init__(self, executable: str, about: About) -> None:
        super().__init__(prog=executable, allow_abbrev=False)
        self._about = about

    def parse(self, command: Sequence[str]) -> Namespace:
        """Parse; exit after showing the help, or with 2 for what is for nobody."""
        from rclpy.utilities import remove_ros_args

        for_ros = False
        for before, rule in pairwise(command):
            for_ros = (for_ros or before == '--ros-args') and before != '--'
            flagged = before.startswith('-') and before != '--ros-args'
            if ':=' in rule and not (for_ros and flagged):
                self._refuse_rule(before, rule)
        try:
            rest = remove_ros_args(list(command))[1:]
        except RuntimeError:  # ROS will not start with these, and says why
            rest = []
        given, unknown = self.parse_known_args(rest)
        if unknown:
            near = near_to(unknown[0], self._option_string_actions)
            meant = f'did you mean {near}? ' if near else ''
            self.error(f'no such option: {" ".join(unknown)}; {meant}{self.prog} --help says more')
        return given

    def format_help(self) -> str:
        """Return the help, in lines that break between words."""
        about, width = self._about, columns(sys.stdout) or _WIDTH
        options = [f'[{option}]' for option in about.options]
        examples = (command_line(split(line), width, '  ') for line in about.examples)
        parameters = {name: _said(field) for name, field in about.parameters.items()}
        parts = [
            wrapped(' '.join(['usage:', self.prog, *options, _ROS_ARGUMENTS]), width, '  '),
            wrapped(about.purpose, width),
            _listed('topics', about.topics, width),
            _listed('main parameters', parameters, width),
            _listed('options', about.options, width),
            'examples:\n' + '\n'.join(examples),
            *(wrapped(paragraph, width) for paragraph in (*about.more, _ALL_PARAMETERS)),
        ]
        return '\n\n'.join(filter(None, parts)) + '\n'

    def print_help(self, file: Any = None) -> None:
        """Write the help, and not a word more where nobody reads on."""
        try:
            print(self.format_help(), end='', flush=True)
        except OSError as error:
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # what is left
            if not isinstance(error, BrokenPipeError):
                self.error(f'output: {error.strerror}')

    def _refuse_rule(self, before: str, rule: str) -> NoReturn:
        """Show how a parameter or a remapping is to be written."""
        flag = before if before in _RULE_FLAGS else '-p'
        self.error(
            'ROS parameters and remappings come after --ros-args, each behind its -p or -r: '
            f'{self.prog} --ros-args {flag} {rule}'
        )

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        print(wrapped(f'error: {message}', columns(sys.stderr)), file=sys.stderr)
        raise SystemExit(2)


def _said(field: Declared) -> str:
    unit = f' [{field.unit}]' if field.unit else ''
    shown = f'{field.default:g}' if field.kind == 'number' else str(field.default)
    return f'{field.description}{unit} (default {shown})'


def _listed(title: str, lines: Mapping[str, str], width: int) -> str:
    longest = max(map(len, lines), default=0)
    shown = (
        wrapped(f'  {name:{longest}}  {text}', width, ' ' * (longest + 4))
        for name, text in lines.items()
    )
    return '\n'.join([f'{title}:', *shown]) if lines else ''
