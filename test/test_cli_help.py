"""What every command of `nadrc` has in common."""

from __future__ import annotations

from typing import Any

from nadrc_ros.cli.app import app, COMMANDS
import pytest
from typer.testing import CliRunner

NAMES = [command.__name__ for command in COMMANDS]


def nadrc(*arguments: str) -> Any:
    return CliRunner().invoke(app, arguments)


@pytest.mark.parametrize('name', NAMES)
def test_the_help_of_a_command_shows_an_example(name: str) -> None:
    shown = nadrc(name, '--help')
    assert shown.exit_code == 0
    assert f'Example: nadrc {name}' in ' '.join(shown.output.split())


@pytest.mark.parametrize('name', NAMES)
def test_an_unknown_option_is_a_mistake_of_usage(name: str) -> None:
    refused = nadrc(name, '--no-such-option')
    assert refused.exit_code == 2
    assert (
        'no such option: --no-such-option' in refused.output and 'Traceback' not in refused.output
    )


def test_a_command_that_does_not_exist_is_named() -> None:
    refused = nadrc('fly')
    assert refused.exit_code == 2 and 'fly' in refused.output
