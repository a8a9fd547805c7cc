"""`nadrc summarise`: the figures of merit of a recorded run, from its samples."""

from pathlib import Path
from typing import Annotated

from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import say, warning
import typer


def summarise(
    run: Annotated[Path, typer.Argument(help='Folder of the run: runs/<date>, with samples.csv.')],
) -> None:
    """
    Write summary.json for a run whose recorder was killed.

    The figures are those of the recorder, from the samples that reached the disk. A summary that
    the recorder wrote at the end of the run is left unchanged.

    Example: nadrc summarise runs/20260101-120000
    """
    with reporting(str(run)):
        from nadrc_ros.atomic import write_json
        from nadrc_ros.cli.table import print_figures_of_merit
        from nadrc_ros.records.figures import summarise
        from nadrc_ros.records.recording import read_settings, read_summary, SUMMARY
        from nadrc_ros.simulation.metrics import MetricValues

        content = summarise(run)
        if content['complete'] is False:
            warning(f'{run}: the last row was cut short and was skipped')
        if gap := content['gap_time']:
            warning(f'{run}: no rows for {gap:.3g} s; no figure counts this time')
        print_figures_of_merit(
            f'{run}, {content["rows"]} rows',
            {'': MetricValues(**content['metrics'])},
            read_settings(run).settle_time,
        )
        if read_summary(run).get('complete') is True:
            say(f'{run / SUMMARY} was written by the recorder; left unchanged')
            return
        write_json(run / SUMMARY, 'summary', content)
        say(f'summary {run / SUMMARY}')
