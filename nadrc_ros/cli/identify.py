"""`nadrc identify`: the plant behind a recorded run."""

# ruff: noqa: UP045
from pathlib import Path
from shlex import split
from typing import Annotated, Optional, TYPE_CHECKING

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli import options
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import note, say, say_command, warning
from nadrc_ros.cli.progress import progress
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun
    from nadrc_ros.scenario.units import Units
    from nadrc_ros.tuning.identification.advice import Advice
    from nadrc_ros.tuning.identification.estimate import Estimate
    from nadrc_ros.tuning.identification.identify import Plant
    from nadrc_ros.tuning.identification.predictor import Log

# A b0 that is off by more, or by more than half of the gain margin (of its decibels), is worth a
# new one.
_TOLERABLE = 2.0
_ONLY_THE_CONTROLLER_KNOWS = ('command_min', 'command_max', 'safe_command')
_PARAMETERS, _SCENARIO, _REFERENCE = 'identify.yaml', 'scenario.yaml', 'reference.csv'
# Effort that a tuning may spend beside that of the start: the noise of other seeds.
_MORE_EFFORT = 1.02
# Of a longer log not every row is used if its motion allows it: the fit takes a minute for these.
_MOST_ROWS = 50_000


@options.takes(where=options.log)
def identify(
    run: Annotated[
        Path, typer.Argument(help='Folder of the recorder, a rosbag2 bag or a CSV file.')
    ],
    order: Annotated[
        Optional[int],
        typer.Option(
            min=1, max=3, help='Order of the plant; by default the best one for the log.'
        ),
    ] = None,
    b0: Annotated[Optional[float], typer.Option(help='The b0 in use, for comparison.')] = None,
    out: Annotated[
        Optional[Path],
        typer.Option(help='Folder for identify.yaml, scenario.yaml and identify.json.'),
    ] = None,
    json: options.JsonFile = None,
    *,
    where: options.Log,
    wrap: Annotated[
        Optional[float],
        typer.Option(
            min=0.0,
            help='Period of a wrapped angle, to unwrap it; 0 = it is none.',
        ),
    ] = None,
    every: Annotated[
        Optional[int],
        typer.Option(min=1, help='Use every so many rows; by default all that are needed.'),
    ] = None,
) -> None:
    """
    Find order, input gain b0 and noise of a plant in the log of its closed loop.

    Says how sure b0 is, and what observer bandwidth noise, rate and delay allow. identify.yaml
    holds ROS parameters of a controller node to start with, scenario.yaml the log's experiment on
    the identified plant, for `nadrc tune`.

    Example: nadrc identify runs/20260101-120000 --out mine, or
    nadrc identify log.csv --time t --measurement rpm --command pwm --from 12
    """
    options.check_outputs(out=out, json=json)
    with reporting():
        if b0 is not None:
            ControllerSettings(b0=b0)  # refuses what cannot be one
        (recorded,) = where.read([run], {}).values()
    with reporting(str(run)):
        from nadrc_ros.tuning.identification.advice import advise, running_controller
        from nadrc_ros.tuning.identification.identify import identify as find

        if wrap is None:
            wrap = recorded.measurement_period or None
        recorded, log, kept, doubts = _prepared(recorded, wrap, every)
        with progress(f'fitting {len(log.command)} samples'):
            # the loop to be designed has the rate of the log, whatever was used of it
            plant = attrs.evolve(find(log, order), period=1.0 / recorded.rate)
        _print_table(f'{run}: {plant.samples} samples, {plant.samples * log.h:.4g} s', plant)
        running = running_controller(recorded.history)
        advice = advise(plant, log, running)
        if wrap and running is None:
            angle = attrs.evolve(advice.settings, measurement_period=wrap)
            advice = attrs.evolve(advice, settings=angle)
        if b0 is None and running and running.plant_order == plant.order:
            b0 = running.b0
    with reporting():
        if json is not None:
            _write_json(json, plant, advice, b0, kept, doubts)
        budget = 0.0
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            _write_json(out / 'identify.json', plant, advice, b0, kept, doubts)
            _write_parameters(out / _PARAMETERS, advice, recorded.rate)
            budget = _write_scenario(out / _SCENARIO, plant, log, advice, recorded.units)
        for line in _verdict(plant, advice, b0):
            say(line)
        if out is not None:
            say(f'{out}: {_PARAMETERS}, {_SCENARIO}, identify.json')
        designed = 'mine' if out is None else str(out / 'design')
        say_command([*split(advice.line), '--out', designed], 'Next: ')
        if out is not None:
            budgeted = '--budget', f'{budget:g}'
            say_command(['nadrc', 'tune', str(out / _SCENARIO), *budgeted], 'Then: ')
        _complain(run, plant, advice, log, out and out / _PARAMETERS)


def _prepared(
    recorded: 'RecordedRun', wrap: Optional[float], every: Optional[int]
) -> 'tuple[RecordedRun, Log, int, list[str]]':
    """Return the run, what the fit gets of it, every which row that is, and doubts."""
    from nadrc_ros.records.angles import unwrapped
    from nadrc_ros.records.shaping import thinned, without_outliers
    from nadrc_ros.tuning.identification.log import log_of, seems_swapped, SWAPPED

    run = recorded.path
    if wrap:
        recorded = attrs.evolve(recorded, columns=unwrapped(recorded.columns, wrap))
    recorded, wrong = without_outliers(recorded)
    if wrong:
        warning(f'{run}: {wrong}')
    if wrap is None:
        _refuse_wrapped(recorded)
    thin, kept = thinned(recorded, _MOST_ROWS, every)
    if kept > 1:
        note(
            f'{run}: every {kept} rows count as one, {thin.rate:.4g} Hz'
            + ('' if every else '; --every 1 uses all of them')
        )
    log = log_of(thin)
    swapped = SWAPPED if seems_swapped(log) else ''
    if swapped:
        warning(f'{run}: {swapped}')
    return recorded, log, kept, [doubt for doubt in (wrong, swapped) if doubt]


def _write_parameters(path: Path, advice: 'Advice', rate: float) -> None:
    from nadrc_ros.atomic import write_whole
    from nadrc_ros.scenario.parameter_files import (
        ANY_CONTROLLER,
        controller_parameters,
        parameter_text,
    )
    from nadrc_ros.tuning.identification.advice import rounded

    parameters = controller_parameters(advice.settings, rounded(rate))
    if not advice.limits_known:
        for name in _ONLY_THE_CONTROLLER_KNOWS:
            del parameters[name]
    write_whole(path, parameter_text({ANY_CONTROLLER: parameters}).encode())


def _write_scenario(
    path: Path, plant: 'Plant', log: 'Log', advice: 'Advice', units: 'Units'
) -> float:
    """Write a scenario that repeats the log, and return the ISU for a tuning of it."""
    from nadrc_ros.atomic import write_whole
    from nadrc_ros.scenario.mapping import to_mapping
    from nadrc_ros.tuning.identification.advice import NAME, reference_text, rounded, scenario_of
    from nadrc_ros.yaml_text import write_yaml

    text = reference_text(log)
    followed = path.with_name(_REFERENCE) if text else None
    if followed is not None:
        write_whole(followed, text.encode())
    repeated = scenario_of(plant, log, advice.settings, followed and followed.resolve())
    repeated = attrs.evolve(repeated, units=units)
    note = '' if advice.limits_known else f'# {_guess(advice, log)}\n'
    content = to_mapping(repeated)
    if followed is not None:
        content['reference']['csv'] = followed.name  # beside it, wherever the folder is put
    write_whole(path, (note + write_yaml(content)).encode())
    return rounded(_MORE_EFFORT * repeated.run(NAME).metrics.isu, 3)


def _complain(
    run: Path, plant: 'Plant', advice: 'Advice', log: 'Log', out: Optional[Path]
) -> None:
    """Say what was guessed, what is doubtful, and what has to be done."""
    from nadrc_ros.scenario.parameter_files import about_reference

    if not advice.limits_known:
        warning(f'{run}: {_guess(advice, log)}')
        if out is not None:
            *first, last = _ONLY_THE_CONTROLLER_KNOWS
            warning(f'{out}: without {", ".join(first)} and {last}: set them before it runs')
    for doubt in plant.doubts:
        warning(f'{run}: {doubt}')
    if out is not None and (remark := about_reference(advice.settings)):
        note(f'{out}: {remark}')


def _guess(advice: 'Advice', log: 'Log') -> str:
    low, high = advice.settings.command_min, advice.settings.command_max
    return (
        f'the limits of the command, {low:g} to {high:g}, are guessed: the log does not contain '
        f'them (its commands are {log.command.min():.4g} to {log.command.max():.4g})'
    )


def _refuse_wrapped(run: 'RecordedRun') -> None:
    from nadrc_ros.records.recording import RecordingError
    from nadrc_ros.records.shaping import PERIODS, wrap_of

    found = wrap_of(run.columns['measurement'])
    if found is not None:
        raise RecordingError(
            f'the measurement jumps by {found:.4g}, as an angle that wraps: --wrap '
            f'{PERIODS[found]} unwraps it, --wrap 0 takes it as it is'
        )


def _write_json(
    path: Path, plant: 'Plant', advice: 'Advice', b0: Optional[float], kept: int, doubts: list[str]
) -> None:
    from nadrc_ros.atomic import write_json

    def plain(estimate: 'Optional[Estimate]') -> Optional[dict[str, float]]:
        if estimate is None:
            return None
        ends = {'low': estimate.low, 'high': estimate.high}
        return {'value': estimate.value, 'standard_error': estimate.error, **ends}

    document = {
        **attrs.asdict(plant, recurse=False),
        **{name: plain(getattr(plant, name)) for name in ('b0', 'damping', 'lateness')},
        'unexplained': {str(n): value for n, value in plant.unexplained.items()},
        'doubts': [*doubts, *plant.doubts],
        'configured_b0': b0,
        'settling_time': advice.design.wanted.settling_time,
        'limited_by': advice.limit,
        'inner_bandwidth': advice.settings.inner_bandwidth,
        'controller_bandwidth': advice.settings.controller_bandwidth,
        'design': advice.line,
        'margins': advice.margins.as_dict(),
        'rows_per_sample': kept,
    }
    write_json(path, 'identify', document)


def _print_table(title: str, plant: 'Plant') -> None:
    from nadrc_ros.cli.table import print_columns, Row
    from nadrc_ros.report.tables import shown_together

    def sure(label: str, estimate: 'Estimate', scale: float = 1.0) -> Row:
        found = [scale * each for each in (estimate.value, estimate.low, estimate.high)]
        return Row(label, '', shown_together('', found, plain=True))

    rows = [
        Row('order', _orders(plant), [f'{plant.order}', '', '']),
        sure('b0', plant.b0),
        sure('damping [1/s]', plant.damping),
    ]
    if plant.damping.low > 0.0:
        (constant,) = shown_together('', [1.0 / plant.damping.value], plain=True)
        rows.append(Row('time constant [s]', '1 / damping', [constant, '', '']))
    noise = 'standard deviation of the measurement'
    rows.append(Row('noise', noise, [*shown_together('', [plant.noise], plain=True), '', '']))
    if plant.lateness is not None:
        rows.append(sure(f'{plant.late} [ms]', plant.lateness, 1e3))
    if plant.dry:
        rows.append(Row(plant.dry, 'found, and allowed for', [''] * 3))
    print_columns(title, ['value', '95 % from', 'to'], rows)


def _orders(plant: 'Plant') -> str:
    if len(plant.unexplained) == 1:
        return 'as asked for'
    others = (
        f'order {n} leaves {100.0 * (ratio - 1.0):.1f} % more unexplained'
        for n, ratio in plant.unexplained.items()
        if n != plant.order
    )
    return ', '.join(others)


def _verdict(plant: 'Plant', advice: 'Advice', b0: Optional[float]) -> list[str]:
    from nadrc_ros.tuning.identification.advice import known_dynamics

    lines = [] if b0 is None else [_compared(plant, advice, b0)]
    best, chosen = advice.settings, advice.design.chosen
    lines.append(
        f'Suggested start: settling time {advice.design.wanted.settling_time:g} s '
        f'(limited by {advice.limit}), {chosen.name}, b0 {best.b0:g}, '
        f'inner_bandwidth {best.inner_bandwidth:g}, '
        f'controller_bandwidth {best.controller_bandwidth:g}.'
    )
    margins = advice.margins
    lines.append(
        f'Stable if the true gain is {margins.gain_low:.2f} to {margins.gain_high:.3g} times b0, '
        f'and with up to {1e3 * margins.delay:.3g} ms of extra delay (modulus margin '
        f'{margins.modulus:.2f}).'
    )
    if told := known_dynamics(plant, best):
        lines.append(told)
    return lines


def _compared(plant: 'Plant', advice: 'Advice', b0: float) -> str:
    found = plant.b0
    if b0 * found.value <= 0.0:
        return f'b0 = {b0:g} has the WRONG SIGN: a loop with it runs away.'
    if found.low <= b0 <= found.high:
        return f'b0 = {b0:g} agrees with the log.'
    ratio = b0 / found.value
    factor, way = (ratio, 'large') if ratio > 1.0 else (1.0 / ratio, 'small')
    margins = advice.margins
    inside = margins.gain_low**0.5 <= 1.0 / ratio <= margins.gain_high**0.5
    worth = 'tolerable' if inside and factor <= _TOLERABLE else 'worth a change'
    said = f'b0 = {b0:g} is {factor:.2f} times too {way}: {worth}'
    if len(plant.unexplained) == 1 or factor <= _TOLERABLE:
        return said + '.'
    return f'{said}. If it is no b0 of order {plant.order}, give its order: --order.'
