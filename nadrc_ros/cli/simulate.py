"""`nadrc simulate`: every controller of a scenario, offline."""

from pathlib import Path
from typing import Any, TYPE_CHECKING

from nadrc_ros.cli import options
from nadrc_ros.cli.failure import reporting, tell_divergence
from nadrc_ros.cli.progress import progress

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun
    from nadrc_ros.scenario import Scenario
    from nadrc_ros.simulation.simulate import Result


def simulate(
    file: options.ScenarioFile,
    json: options.JsonFile = None,
    plot: options.PlotFile = None,
    page: options.PageFile = None,
    duration: options.Duration = None,
    seed: options.Seed = None,
    noise_variance: options.NoiseVariance = None,
    rate: options.Rate = None,
) -> None:
    """
    Run a scenario offline and compare its controllers.

    Example: nadrc simulate demo --plot demo.png, or nadrc simulate mine.yaml --seed 7
    """
    options.check_outputs(json=json, plot=plot, page=page)
    with reporting(file):
        from nadrc_ros.scenario import find_scenario, load
        import numpy as np

        path = find_scenario(file)
        whole = load(path)
    with reporting():
        scenario = options.changed(
            whole, duration=duration, rate=rate, seed=seed, noise_variance=noise_variance
        )
    with reporting(file):
        results = {}
        for name in scenario.controllers:
            with progress(f'simulating {name}'):
                results[name] = scenario.run(name)
        for name, result in results.items():
            if not np.isfinite(result.output).all():
                tell_divergence(name, result.time, result.output)
        if json is not None:
            _write_json(json, scenario, results)
        if plot is not None:
            _write_plot(plot, path, scenario, results)
        if page is not None:
            _write_page(page, path, scenario, results)
        _print_table(path.stem, scenario, results)


def _write_json(path: Path, scenario: 'Scenario', results: 'dict[str, Result]') -> None:
    from nadrc_ros.atomic import write_json
    from nadrc_ros.scenario.mapping import to_mapping

    document: dict[str, Any] = {
        'scenario': to_mapping(scenario),
        'runs': {name: result.metrics.as_dict() for name, result in results.items()},
    }
    write_json(path, 'simulate', document)


def _write_plot(
    plot: Path, path: Path, scenario: 'Scenario', results: 'dict[str, Result]'
) -> None:
    from nadrc_ros.atomic import write_whole
    from nadrc_ros.report.marks import title_of
    from nadrc_ros.report.picture import draw
    from nadrc_ros.report.style import render

    figure = draw(_runs(path, scenario, results), title_of(path.stem, scenario))
    write_whole(plot, render(figure, plot.suffix.lstrip('.')))


def _write_page(
    page: Path, path: Path, scenario: 'Scenario', results: 'dict[str, Result]'
) -> None:
    from nadrc_ros.cli.pages import write_page

    write_page(page, _runs(path, scenario, results))


def _runs(
    path: Path, scenario: 'Scenario', results: 'dict[str, Result]'
) -> 'dict[str, RecordedRun]':
    from nadrc_ros.records.simulated import recorded

    return {name: recorded(path, scenario, name, result) for name, result in results.items()}


def _print_table(name: str, scenario: 'Scenario', results: 'dict[str, Result]') -> None:
    from nadrc_ros.cli.table import print_figures_of_merit
    from nadrc_ros.report.marks import title_of

    metrics = {run: result.metrics for run, result in results.items()}
    settled = scenario.experiment.settled
    print_figures_of_merit(title_of(name, scenario), metrics, settled, scenario.units)
