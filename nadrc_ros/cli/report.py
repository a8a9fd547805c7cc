"""`nadrc report`: what recorded runs look like, as one page that works offline."""

# ruff: noqa: UP045
from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

from nadrc_ros.cli import options
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import say
from nadrc_ros.cli.pages import load_page, write_page
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun


@options.takes(log=options.log)
def report(
    runs: Annotated[
        list[Path],
        typer.Argument(help='Folders of runs (runs/<date>), rosbag2 bags or CSV files.'),
    ],
    page: Annotated[
        Optional[Path],
        typer.Option(help='Write the page to this file; by default beside the first run.'),
    ] = None,
    plot: Annotated[
        Optional[Path],
        typer.Option(
            help='Draw a picture to this file (png, svg, pdf), and no page without --page.'
        ),
    ] = None,
    topic: Annotated[
        Optional[list[str]],
        typer.Option(help='Topic or column of another signal: output=/true; repeatable.'),
    ] = None,
    *,
    log: options.Log,
) -> None:
    """
    Make a page of one run, or of several to compare them.

    It has interactive plots, figures of merit, the disturbance estimates against the truth, the
    spectrum of the command, latencies, and the parameters with their changes.

    Example: nadrc report runs/20260101-120000, or nadrc report runs/A log.csv --page ab.html
    """
    beside = _beside(runs)
    options.check_outputs(page=page or (beside if beside.parent.is_dir() else None), plot=plot)
    with reporting():
        if page is not None or plot is None:
            load_page()
        found = log.read(runs, _topics(topic or []))
        if plot is not None:
            _draw(plot, found)
            if page is None:
                return
        write_page(page or beside, found)


def _draw(path: Path, runs: 'dict[str, RecordedRun]') -> None:
    from nadrc_ros.atomic import write_whole
    from nadrc_ros.report.picture import draw
    from nadrc_ros.report.style import render
    from nadrc_ros.report.summary import title_of

    figure = draw(runs, title_of(runs))
    write_whole(path, render(figure, path.suffix.lstrip('.')))
    say(f'picture {path}')


def _beside(runs: list[Path]) -> Path:
    """Return a file that no later `nadrc report runs/*` takes for a run."""
    name = 'report.html' if len(runs) == 1 else 'comparison.html'
    first = runs[0]
    return first / name if first.is_dir() else first.with_name(f'{first.name}.{name}')


def _topics(pairs: list[str]) -> dict[str, str]:
    topics = {}
    for pair in pairs:
        name, sign, topic = pair.partition('=')
        if not (name and sign and topic):
            raise typer.BadParameter(f'{pair}: must be SIGNAL=TOPIC', param_hint='--topic')
        topics[name] = topic
    return topics
