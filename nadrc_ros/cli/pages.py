"""Writes the interactive page on runs, which needs more packages than the rest."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from nadrc_ros.cli.messages import say

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun


def load_page() -> 'Callable[[dict[str, RecordedRun]], str]':
    """Return what makes a page of runs, or say before any work what is not installed."""
    try:
        from nadrc_ros.report.page import page
    except ImportError as error:
        from nadrc_ros.extras import MissingPackage

        without = '--plot needs nothing'
        raise MissingPackage('the page', error.name or 'bokeh', 'report', without) from None
    return page


def write_page(path: Path, runs: 'dict[str, RecordedRun]') -> None:
    """Write the page on these runs, by name, and say where it is."""
    from nadrc_ros.atomic import write_whole

    write_whole(path, load_page()(runs).encode())
    say(f'report {path}')
