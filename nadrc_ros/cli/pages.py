"""Writes the interactive page on runs, which needs more packages than the rest."""

from pathlib import Path
from typing import TYPE_CHECKING

from nadrc_ros.cli.messages import say

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun


def write_page(path: Path, runs: 'dict[str, RecordedRun]') -> None:
    """Write the page on these runs, by name, and say where it is."""
    try:
        from nadrc_ros.report.page import page
    except ImportError as error:
        from nadrc_ros.extras import MissingPackage

        without = '--plot needs nothing'
        raise MissingPackage('the page', error.name or 'bokeh', 'report', without) from None
    from nadrc_ros.atomic import write_whole

    write_whole(path, page(runs).encode())
    say(f'report {path}')
