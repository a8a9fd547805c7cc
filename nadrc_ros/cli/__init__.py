"""The `nadrc` command line."""

from __future__ import annotations


def main() -> None:
    """Run the command line."""
    import os
    import sys

    # The matrices here are small: threads of OpenBLAS would only wait for them, and busily.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    try:
        from nadrc_ros.cli.app import app

        app()
    except (Exception, KeyboardInterrupt) as error:  # while the modules were being imported
        if not interrupted(error):
            raise
        sys.exit(130)


def interrupted(error: BaseException | None) -> bool:
    """Tell whether Ctrl-C is behind an error: inside an import it may come out as another one."""
    while error is not None and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None
