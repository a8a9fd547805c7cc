"""The `nadrc` command line."""

from __future__ import annotations


def main() -> None:
    """Run the command line."""
    import sys

    try:
        from nadrc_ros.cli.app import app

        app()
    except KeyboardInterrupt:  # while the modules were being imported
        sys.exit(130)
