"""`nadrc sweep`: a scenario over a grid of values and seeds, into a table."""

# ruff: noqa: UP045
from concurrent.futures import BrokenExecutor, CancelledError, Executor
from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

from nadrc_ros.cli.failure import INTERRUPTED, reporting, USER_ERROR
from nadrc_ros.cli.messages import error, note, say
from nadrc_ros.cli.options import check_outputs
from nadrc_ros.cli.progress import progress
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.run_table import RunTable
    from nadrc_ros.scenario.sweep import Sweep


def sweep(
    file: Annotated[Path, typer.Argument(help='Sweep file: scenario, vary, seeds.')],
    table: Annotated[
        Optional[Path],
        typer.Option(
            help='Write the table to this file, .csv or .parquet; by default named as FILE, here.'
        ),
    ] = None,
    jobs: Annotated[
        Optional[int], typer.Option(min=1, help='Processes; by default one per core.')
    ] = None,
    dask: Annotated[
        Optional[str],
        typer.Option(help='Address of a Dask scheduler, to use its workers: tcp://host:8786.'),
    ] = None,
) -> None:
    """
    Run a scenario over a grid of values and seeds and tabulate the figures of merit.

    A row per run. After Ctrl-C, a crash or a kill the same command goes on where it ended, and
    the table is the same in the end.

    Example: nadrc sweep config/sweeps/bandwidth.yaml --table bandwidth.parquet
    """
    path = table or Path(f'{file.stem}.csv')
    check_outputs(table=path)
    with reporting(str(file)):
        from nadrc_ros.cli.workers import cluster, processes
        from nadrc_ros.records.run_table import RunTable
        from nadrc_ros.scenario.sweep import load_sweep
        from nadrc_ros.simulation.simulate import WORTH_COMPILING

        wanted = load_sweep(file)
        extent = wanted.check()
    with reporting():
        rows = RunTable(path, wanted, extent)
        try:
            if rows.done < rows.runs:
                fast = extent.periods >= WORTH_COMPILING
                with cluster(dask) if dask else processes(jobs) as executor:
                    _fill(rows, wanted, executor, fast, extent.periods)
            rows.finish()
        except (KeyboardInterrupt, BrokenExecutor, CancelledError) as ended:
            interrupted = isinstance(ended, KeyboardInterrupt)
            error(
                f'{"interrupted" if interrupted else "the workers are gone"}: '
                f'{rows.done} of {rows.runs} runs are kept; '
                'the same command goes on from there'
            )
            raise typer.Exit(INTERRUPTED if interrupted else USER_ERROR) from None
        finally:
            rows.close()
        say(f'{rows.runs} runs in {path}')


def _fill(
    table: 'RunTable', wanted: 'Sweep', executor: Executor, fast: bool, periods: int
) -> None:
    from nadrc_ros.scenario.sweep import run_range
    from nadrc_ros.simulation.batch import batch_size, stream

    size = batch_size(table.runs, periods, fast)
    tasks = (
        (wanted, start, min(start + size, table.runs), fast, note)
        for start in range(table.done, table.runs, size)
    )
    with progress('sweeping, runs', table.runs, table.done) as tell:
        for found in stream(executor, run_range, tasks):
            table.append(found)
            tell(table.done, '')
