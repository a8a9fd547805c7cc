"""The `nadrc` command line."""

from __future__ import annotations

import os


def called() -> str:
    """Return how this command line was called, for lines to be copied."""
    return os.environ.get('NADRC', 'nadrc')


def interrupted(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: inside an import it may come out as another one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
