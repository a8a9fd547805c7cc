"""`nadrc demo`: a scenario as real processes on the ROS graph."""

from pathlib import Path
from typing import Annotated, Any, TYPE_CHECKING

from nadrc_ros.cli import called, options
from nadrc_ros.cli.failure import reporting, tell_divergence, USER_ERROR
from nadrc_ros.cli.live import pages_of, wait_for_ctrl_c
from nadrc_ros.cli.messages import error, note, say, say_command, warning
from nadrc_ros.cli.progress import progress
import typer

if TYPE_CHECKING:
    from nadrc_ros.demo.run import Run
    from nadrc_ros.records.recorded_run import RecordedRun
    from nadrc_ros.scenario import Scenario


_FROM_THE_RECORDER = ('itae', 'isu', 'peak_error', 'max_command', 'total_variation')


def demo(
    file: options.ScenarioFile = 'demo',
    duration: options.Duration = None,
    seed: options.Seed = None,
    rate: options.Rate = None,
    noise_variance: options.NoiseVariance = None,
    lockstep: Annotated[
        bool, typer.Option(help='One step per sample: the bits of the offline simulation.')
    ] = False,
    keep_open: Annotated[
        bool, typer.Option(help='Leave the nodes running at the end, until Ctrl-C.')
    ] = False,
    live: Annotated[
        bool,
        typer.Option(help='Serve a page of each loop, see `nadrc live`; implies --keep-open.'),
    ] = False,
    out: Annotated[Path, typer.Option(help='Folder for table, picture and runs.')] = Path(
        'out/demo'
    ),
) -> None:
    """
    Run a scenario live on ROS 2, each node in its own process.

    Each controller has a plant, a reference and a recorder of its own, in a namespace named
    after it.

    Example: nadrc demo --duration 5, or nadrc demo paper --lockstep.
    """
    options.check_outputs(out=out)
    if live and lockstep:
        raise typer.BadParameter(
            'not with --lockstep, which waits for nobody', param_hint='--live'
        )
    with reporting(file):
        from nadrc_ros.scenario import find_scenario, load

        path = find_scenario(file)
        whole = load(path)
    before = _run_folders(whole, out)

    def kept() -> str:
        folders = [str(folder) for folder in _run_folders(whole, out) if folder not in before]
        return 'the runs are kept in ' + ', '.join(folders) if folders else ''

    with reporting(after_interrupt=kept):
        try:
            from nadrc_ros.ros.runtime import private_domain
            import rclpy  # noqa: F401
        except ImportError as error:
            from nadrc_ros.adrc.errors import UserError

            raise UserError(
                f'ROS 2 is not here ({error}): source it, or use `make demo`'
            ) from None
        scenario = options.changed(
            whole, duration=duration, rate=rate, seed=seed, noise_variance=noise_variance
        )
        domain = private_domain(keep=True)
        say(f'ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST')
        out.mkdir(parents=True, exist_ok=True)
        if lockstep:
            runs = _in_lockstep(scenario, out)
        else:
            shown = [f'/{name}/controller' for name in scenario.controllers] if live else []
            with pages_of(shown):
                runs = _in_real_time(scenario, out, keep_open or live)
        recorded = {name: _recorded(scenario, name, run.folder) for name, run in runs.items()}
        for name, run in recorded.items():
            # In lockstep the event comes when it comes: the rows know better when it was.
            if any(event.kind == 'diverged' for event in run.events):
                tell_divergence(name, run.time, run.output)
        _print_table(path.stem, scenario, runs)
        _write_picture(out / 'demo.png', path.stem, scenario, recorded)
        _write_summary(out / 'summary.json', path.stem, lockstep, scenario, runs)
        say(f'picture {out / "demo.png"}, figures {out / "summary.json"}')
        say_command([called(), 'report', *(str(r.folder) for r in runs.values())], 'more in: ')
        if lockstep:
            _compare(scenario, runs)


def _run_folders(scenario: 'Scenario', out: Path) -> list[Path]:
    return [
        folder
        for name in scenario.controllers
        for folder in sorted((out / name / 'runs').glob('*'))
        if folder.is_dir()
    ]


def _in_real_time(scenario: 'Scenario', out: Path, keep_open: bool) -> 'dict[str, Run]':
    from nadrc_ros.demo.run import run_realtime

    with progress('running', scenario.duration, unit='s') as tell:

        def show(now: float, itae: dict[str, float]) -> None:
            shown = '  '.join(f'{name} {value:.3f}' for name, value in sorted(itae.items()))
            tell(now, f'ITAE {shown}' if shown else '')

        return run_realtime(scenario, out, show, wait_for_ctrl_c if keep_open else None)


def _in_lockstep(scenario: 'Scenario', out: Path) -> 'dict[str, Run]':
    from nadrc_ros.demo.run import run_lockstep

    for retune in scenario.retunes:
        warning(f'lockstep: the retune at {retune.time:g} s was skipped')
    return run_lockstep(scenario, out, lambda name: note(f'{name}: running in lockstep ...'))


def _figures(run: 'Run') -> dict[str, Any]:
    """Return the figures of one run, None where lockstep has none."""
    metrics, counted = run.summary['metrics'], run.diagnostics
    return {
        **{name: metrics[name] for name in _FROM_THE_RECORDER},
        'periods': int(counted.get('periods', run.summary['rows'])),
        'missed_periods': int(counted.get('missed_periods', 0)),
        'latency_median_ms': counted.get('latency_median_ms'),
        'latency_p99_ms': counted.get('latency_p99_ms'),
        'samples_lost': run.summary['samples_lost'],
    }


def _print_table(name: str, scenario: 'Scenario', runs: 'dict[str, Run]') -> None:
    from math import nan

    from nadrc_ros.cli.table import print_columns, Row
    from nadrc_ros.report.marks import title_of
    from nadrc_ros.report.tables import shown_together
    from nadrc_ros.scenario.units import with_unit

    labels = {
        'itae': ('ITAE', 'integral of t |e|'),
        'isu': ('ISU', 'integral of u²'),
        'peak_error': ('peak |e|', f'largest error from {scenario.experiment.settled:g} s on'),
        'max_command': ('max |u|', 'largest command'),
        'total_variation': ('TV', 'total variation of u'),
        'periods': ('periods', 'of the controller'),
        'missed_periods': ('missed', 'periods without a step'),
        'latency_median_ms': ('latency [ms]', 'from measurement to command, median'),
        'latency_p99_ms': ('99 % [ms]', 'of the latencies are below this'),
        'samples_lost': ('lost', 'samples that the recorder missed'),
    }
    figures = [_figures(run) for run in runs.values()]
    rows = []
    for key, (label, meaning) in labels.items():
        values = [nan if each[key] is None else each[key] for each in figures]
        counted = all(isinstance(value, int) for value in values)
        texts = list(map(str, values)) if counted else shown_together(key, values, plain=True)
        rows.append(Row(with_unit(label, scenario.units.of_figure(key)), meaning, texts))
    print_columns(title_of(name, scenario), list(runs), rows)


def _write_picture(
    path: Path, name: str, scenario: 'Scenario', recorded: 'dict[str, RecordedRun]'
) -> None:
    from nadrc_ros.atomic import write_whole
    from nadrc_ros.report.marks import title_of
    from nadrc_ros.report.picture import draw
    from nadrc_ros.report.style import render

    figure = draw(recorded, title_of(name, scenario))
    write_whole(path, render(figure, 'png'))


def _recorded(scenario: 'Scenario', name: str, folder: Path) -> 'RecordedRun':
    """Read a run with the truth for b0 of the controller, if need be that of the scenario."""
    import attrs
    from nadrc_ros.records.read_run import read_run
    from nadrc_ros.records.recorded_run import modelled, reached, referred, scheduled

    run = read_run(folder)
    if run.referred:
        return run
    # A short run in lockstep tells no parameters, and b0 of a user's plant is in no record.
    gains = run.gains[1] or [(0.0, scenario.controllers[name].b0)]
    plant = [(0.0, scenario.plant.make().b0)]
    acted = reached(
        run.time, run.command, scenario.input_delay, scenario.controllers[name].safe_command
    )
    truth = referred(run.time, acted, run.column('total_disturbance'), plant, gains)
    settings = run.history.controller_settings() or [(0.0, scenario.controllers[name])]
    truth = scheduled(run.columns, acted, truth, settings)
    truth = modelled(run.time, run.output, truth, settings)
    return attrs.evolve(run, columns=run.columns | {'total_disturbance': truth})


def _write_summary(
    path: Path, name: str, lockstep: bool, scenario: 'Scenario', runs: 'dict[str, Run]'
) -> None:
    from nadrc_ros.atomic import write_json

    write_json(
        path,
        'demo',
        {
            'scenario': name,
            'pacing': 'lockstep' if lockstep else 'realtime',
            'rate': scenario.rate,
            'duration': scenario.duration,
            'runs': {run: _figures(result) for run, result in runs.items()},
        },
    )


def _compare(scenario: 'Scenario', runs: 'dict[str, Run]') -> None:
    """Say whether the graph gave the bits of the offline simulation."""
    import attrs

    offline = attrs.evolve(scenario, retunes=())
    for name, run in runs.items():
        same = list(offline.run(name).command) == run.samples['command']
        if same:
            say(f'{name}: the same bits as the simulation')
        else:
            error(f'{name}: NOT THE BITS of the simulation')
            raise typer.Exit(USER_ERROR)
