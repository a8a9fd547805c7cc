"""
The commands of `nadrc`, one module each.

Those modules import only what describes their options, and the rest inside the command, so that
help answers at once. Two habits are left out for the typer of Ubuntu 24.04: it refuses `X | None`,
and behind `from __future__ import annotations` it does not see the descriptions of the options.
"""

from itertools import pairwise
import re
import sys
from typing import Annotated, Any

from nadrc_ros.adrc.errors import near_to
from nadrc_ros.cli import messages
from nadrc_ros.cli.commission import commission
from nadrc_ros.cli.demo import demo
from nadrc_ros.cli.design import design
from nadrc_ros.cli.export import export
from nadrc_ros.cli.failure import naming, reporting, USAGE_ERROR
from nadrc_ros.cli.identify import identify
from nadrc_ros.cli.live import live
from nadrc_ros.cli.report import report
from nadrc_ros.cli.scenarios import scenarios
from nadrc_ros.cli.simulate import simulate
from nadrc_ros.cli.summarise import summarise
from nadrc_ros.cli.sweep import sweep
from nadrc_ros.cli.tune import tune
from nadrc_ros.cli.wire import fields, wire
import typer
from typer.core import TyperCommand, TyperGroup

COMMANDS = (
    design,
    scenarios,
    simulate,
    demo,
    live,
    report,
    identify,
    commission,
    sweep,
    tune,
    export,
    summarise,
    fields,
    wire,
)


_UNBROKEN = '\N{NON-BREAKING HYPHEN}'
# Of click, which newer typers bring along under another name.
_UsageError: Any = typer.BadParameter.__mro__[1]


class _Command(TyperCommand):
    """Lets errors name the options that were typed."""

    def invoke(self, ctx: Any) -> Any:
        """Run the command."""
        names = [option for option in self.params if option.param_type_name == 'option']
        typed = {
            option.name: option.opts[0]
            for option in names
            if getattr(ctx.get_parameter_source(option.name), 'name', '') == 'COMMANDLINE'
        }
        with naming(typed):
            return super().invoke(ctx)

    def shell_complete(self, ctx: Any, incomplete: str) -> Any:
        """Return what may follow; typer takes brackets, as of units, for markup and drops them."""
        found = super().shell_complete(ctx, incomplete)
        for item in found:
            item.help = item.help and item.help.replace('[', '(').replace(']', ')')
        return found

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help as click does: the boxes of rich break words where a terminal is narrow."""
        _keep_words_whole(formatter)
        super(TyperCommand, self).format_help(ctx, formatter)


class _Commands(TyperGroup):
    """Ends a command in a line, wherever in it the error or the interrupt came."""

    def main(self, *args: Any, **more: Any) -> Any:
        """Run the command line, and end the process."""
        try:
            code = super().main(*args, **(more | {'standalone_mode': False}))
        except _UsageError as refused:
            words = more.get('args') or next(iter(args), None) or sys.argv[1:]
            messages.error(_refusal(refused, list(words)))
            if refused.ctx is not None:
                path = refused.ctx.command_path
                usage = refused.ctx.get_usage().removeprefix('Usage: ')
                messages.note(f'usage: {usage}; {path} --help says more')
            code = USAGE_ERROR
        raise SystemExit(code)

    def invoke(self, ctx: Any) -> Any:
        """Run the command that was asked for."""
        with reporting():
            return super().invoke(ctx)

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write help as that of a command."""
        _keep_words_whole(formatter)
        super(TyperGroup, self).format_help(ctx, formatter)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write all of the first sentence about each command."""
        with formatter.section('Commands'):
            formatter.write_dl([(c.__name__, _first_sentence(c)) for c in COMMANDS])


def _keep_words_whole(formatter: Any) -> None:
    """Let no line of a help end within an option: click breaks lines behind hyphens, too."""
    write_dl, write_text, getvalue = formatter.write_dl, formatter.write_text, formatter.getvalue

    def whole(text: str) -> str:
        return text.replace('-', _UNBROKEN)

    formatter.write_dl = lambda rows, **more: write_dl([(a, whole(b)) for a, b in rows], **more)
    formatter.write_text = lambda text: write_text(whole(text))
    formatter.getvalue = lambda: getvalue().replace(_UNBROKEN, '-')


def _refusal(refused: Any, words: list[str]) -> str:
    """Return a usage error in one line, with the value that was typed or may have been meant."""
    name, near = getattr(refused, 'option_name', ''), getattr(refused, 'possibilities', None)
    if name:
        return f'no such option: {name}' + (
            f'; did you mean {" or ".join(sorted(near))}?' if near else ''
        )
    message: str = refused.format_message().rstrip('.')
    if missing := re.match("No such command '(.*?)'", message):
        near = near_to(missing[1], [command.__name__ for command in COMMANDS])
        return f'no such command: {missing[1]}' + (f'; did you mean {near}?' if near else '')
    options = getattr(getattr(refused, 'param', None), 'opts', ())
    typed = next((value for option, value in pairwise(words) if option in options), '')
    more = f', not {typed}' if typed and typed not in message else ''
    return message[:1].lower() + message[1:] + more


def _first_sentence(command: Any) -> str:
    return ' '.join(command.__doc__.strip().split('\n\n')[0].split())


app = typer.Typer(
    cls=_Commands,
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={'max_content_width': 100},
)
for _command in COMMANDS:
    app.command(cls=_Command)(_command)


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
    ctx: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            '--version', callback=_print_version, is_eager=True, help='Print the version and exit.'
        ),
    ] = False,
) -> None:
    """Active disturbance rejection control with nested extended state observers."""
    if ctx.invoked_subcommand is None:
        typer.echo(ctx.get_help())
        raise typer.Exit(USAGE_ERROR)
