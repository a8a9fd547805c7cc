"""
The commands of `nadrc`, one module each.

Those modules import only what describes their options, and the rest inside the command, so that
help answers at once. Two habits are left out for the typer of Ubuntu 24.04: it refuses `X | None`,
and behind `from __future__ import annotations` it does not see the descriptions of the options.
"""

from typing import Annotated, Any

from nadrc_ros.cli.demo import demo
from nadrc_ros.cli.design import design
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.identify import identify
from nadrc_ros.cli.report import report
from nadrc_ros.cli.simulate import simulate
from nadrc_ros.cli.summarise import summarise
from nadrc_ros.cli.sweep import sweep
from nadrc_ros.cli.tune import tune
from nadrc_ros.cli.wire import fields, wire
import typer
from typer.core import TyperGroup

COMMANDS = (design, simulate, demo, report, identify, sweep, tune, summarise, fields, wire)


class _Commands(TyperGroup):
    """Ends an interrupted command as such, wherever in it the interrupt came."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        with reporting():
            return super().invoke(ctx)


app = typer.Typer(
    cls=_Commands, no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False
)
for _command in COMMANDS:
    app.command()(_command)


def _print_version(asked: bool) -> None:
    if not asked:
        return
    from importlib.metadata import PackageNotFoundError, version

    try:
        typer.echo('nadrc ' + version('nadrc_ros'))
    except PackageNotFoundError:
        typer.echo('nadrc, run from a source tree')
    raise typer.Exit


@app.callback()
def nadrc(
    version: Annotated[
        bool,
        typer.Option(
            '--version', callback=_print_version, is_eager=True, help='Print the version and exit.'
        ),
    ] = False,
) -> None:
    """Active disturbance rejection control with nested extended state observers."""
