"""How a command ends when something went wrong: one line, no traceback."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

from nadrc_ros.cli import interrupted
from nadrc_ros.cli.messages import error, say, warning
import typer

if TYPE_CHECKING:
    from nadrc_ros.adrc.errors import SettingError
    from nadrc_ros.records.recorded_run import Array

USER_ERROR = 1
USAGE_ERROR = 2
INTERRUPTED = 130


# The options that were typed, by the names of what they set.
_typed: ContextVar[Mapping[str, str]] = ContextVar('typed')


@contextmanager
def naming(options: Mapping[str, str]) -> Iterator[None]:
    """Let errors about a setting name the option that was typed for it."""
    token = _typed.set(options)
    try:
        yield
    finally:
        _typed.reset(token)


@contextmanager
def reporting(
    file: str = '',
    after_interrupt: Callable[[], str] | None = None,
    after_error: Callable[[], str] | None = None,
) -> Iterator[None]:
    """
    Report what the user can mend on stderr, with the name of the file it is about.

    Exit codes: 1 for an error of the user, after which ``after_error()`` is said, and 130 for
    Ctrl-C, with ``after_interrupt()``. Anything else is a bug and keeps its traceback.
    """
    from nadrc_ros.adrc.errors import SettingError, UserError

    try:
        yield
    except (typer.Exit, BrokenPipeError):
        raise  # nobody reads on: typer ends silently
    except (Exception, KeyboardInterrupt) as failure:
        if interrupted(failure):
            kept = after_interrupt() if after_interrupt else ''
            error(f'interrupted: {kept}' if kept else 'interrupted')
            raise typer.Exit(INTERRUPTED) from None
        if isinstance(failure, SettingError) and not file:
            error(_as_typed(failure))
        elif isinstance(failure, UserError):
            error(f'{file}: {failure}' if file else str(failure))
        elif isinstance(failure, OSError):
            error(f'{failure.filename or "output"}: {failure.strerror or failure}')
        else:
            raise
        if kept := after_error() if after_error else '':
            say(kept)
        raise typer.Exit(USER_ERROR) from None


def _as_typed(failure: SettingError) -> str:
    name, _, inner = failure.name.partition('.')
    option = _typed.get({}).get(name)
    return str(failure) if option is None else str(failure.called(f'{option} {inner}'.strip()))


def tell_divergence(name: str, time: Array, output: Array) -> None:
    """Say from when on the output of a plant is no number; ``time`` [s] and ``output``, (N,)."""
    import numpy as np

    lost = time[~np.isfinite(output)]
    when = f' at {lost[0]:g} s' if lost.size else ''
    warning(f'{name}: the plant diverged{when}; the figures are of the time before')
