"""How a command ends when something went wrong: one line, no traceback."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from nadrc_ros.cli import interrupted
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import Array

USER_ERROR = 1
INTERRUPTED = 130


@contextmanager
def reporting(file: str = '', after_interrupt: str = '') -> Iterator[None]:
    """
    Report what the user can mend on stderr, with the name of the file it is about.

    Exit codes: 1 for an error of the user, and 130 for Ctrl-C, when ``after_interrupt`` is said.
    Anything else is a bug and keeps its traceback.
    """
    from nadrc_ros.adrc.errors import UserError

    try:
        yield
    except (typer.Exit, BrokenPipeError):
        raise  # nobody reads on: typer ends silently
    except (Exception, KeyboardInterrupt) as error:
        if interrupted(error):
            complain(f'interrupted: {after_interrupt}' if after_interrupt else 'interrupted')
            raise typer.Exit(INTERRUPTED) from None
        if isinstance(error, UserError):
            complain(f'{file}: {error}' if file else str(error))
        elif isinstance(error, OSError):
            complain(f'{error.filename or "output"}: {error.strerror or error}')
        else:
            raise
        raise typer.Exit(USER_ERROR) from None


def tell_divergence(name: str, time: Array, output: Array) -> None:
    """Say from when on the output of a plant is no number; ``time`` [s] and ``output``, (N,)."""
    import numpy as np

    lost = time[~np.isfinite(output)]
    when = f' at {lost[0]:g} s' if lost.size else ''
    complain(f'{name}: the plant diverged{when}; the figures are of the time before')


def complain(message: str) -> None:
    """Write one line to stderr."""
    typer.echo(f'nadrc: {message}', err=True)
