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
    except KeyboardInterrupt:  # while the modules were being imported
        sys.exit(130)
