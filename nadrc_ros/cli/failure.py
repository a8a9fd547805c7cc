"""How a command ends when something went wrong: one line, no traceback."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import typer

USER_ERROR = 1
INTERRUPTED = 130


@contextmanager
def reporting(file: str = '') -> Iterator[None]:
    """
    Report what the user can mend on stderr, with the name of the file it is about.

    Exit codes: 1 for an error of the user, 130 for Ctrl-C. Anything else is a bug and keeps its
    traceback.
    """
    from nadrc_ros.adrc.errors import UserError

    try:
        yield
    except UserError as error:
        complain(f'{file}: {error}' if file else str(error))
        raise typer.Exit(USER_ERROR) from None
    except OSError as error:
        complain(f'{error.filename}: {error.strerror}' if error.filename else str(error))
        raise typer.Exit(USER_ERROR) from None
    except KeyboardInterrupt:
        complain('interrupted')
        raise typer.Exit(INTERRUPTED) from None


def complain(message: str) -> None:
    """Write one line to stderr."""
    typer.echo(f'nadrc: {message}', err=True)
