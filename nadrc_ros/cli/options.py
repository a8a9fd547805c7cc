"""
Options of several commands, and what follows from them.

A command :func:`takes` an argument that is made from options of its own: those that a maker has,
as :func:`log` for logs that are not the recorder's, or the declared fields of a class.
"""

# ruff: noqa: UP045
from collections.abc import Callable, Sequence
from functools import wraps
from inspect import Parameter, Signature, signature
from pathlib import Path
import re
from typing import Annotated, Any, NamedTuple, Optional, TYPE_CHECKING

import attrs
from nadrc_ros.adrc.fields import Declared, declared
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import note
from nadrc_ros.cli.progress import progress
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.recorded_run import RecordedRun
    from nadrc_ros.records.source import Source
    from nadrc_ros.scenario import Scenario

_KINDS: dict[str, Any] = {
    'numbers': list[float],
    'number': float,
    'integer': int,
    'choice': str,
    'flag': bool,
    'text': str,
}
_PICTURES = ('.png', '.svg', '.pdf')
_TABLES = ('.csv', '.parquet')


def _shipped() -> list[str]:
    """Return what completes the name of a scenario; where nothing fits, shells complete files."""
    from nadrc_ros.scenario.files import shipped_scenarios

    return list(shipped_scenarios())


ScenarioFile = Annotated[
    str,
    typer.Argument(
        help='Scenario file, or the name of a shipped one: nadrc scenarios.',
        autocompletion=_shipped,
    ),
]
# What changes a scenario.
Duration = Annotated[Optional[float], typer.Option(help='Length of the run in seconds.')]
Rate = Annotated[Optional[float], typer.Option(help='Control periods per second.')]
NoiseVariance = Annotated[Optional[float], typer.Option(help='Variance of the noise, 0 for none.')]


Seed = Annotated[Optional[int], typer.Option(help='Seed of the noise.')]
# Where results go. A folder for all of them is --out.
JsonFile = Annotated[Optional[Path], typer.Option(help='Write all figures to this file.')]
PlotFile = Annotated[
    Optional[Path], typer.Option(help='Draw a picture to this file (png, svg, pdf).')
]
PageFile = Annotated[Optional[Path], typer.Option(help='Write an interactive page to this file.')]


def takes(**makers: Callable[..., Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command, in place of each argument that is named, the options of its maker."""

    def with_options(command: Callable[..., None]) -> Callable[..., None]:
        made = {name: signature(maker).parameters for name, maker in makers.items()}
        options = [
            option.replace(kind=Parameter.KEYWORD_ONLY)
            for name, own in signature(command).parameters.items()
            for option in (made[name].values() if name in made else [own])
        ]

        @wraps(command)
        def run(**given: Any) -> None:
            arguments = {
                name: makers[name](**{option: given.pop(option) for option in own})
                for name, own in made.items()
            }
            command(**arguments, **given)

        run.__signature__ = Signature(options)  # type: ignore[attr-defined]
        run.__annotations__ = {option.name: option.annotation for option in options}
        return run

    return with_options


def fields(cls: type[Any], required: str = '', unset: bool = False) -> Callable[..., Any]:
    """
    Return a maker of values by name, with an option for each declared field of a class.

    One may be ``required``. Where ``unset``, those that were not given are left out, as they may
    come from elsewhere.
    """

    def make(**values: Any) -> dict[str, Any]:
        return {name: value for name, value in values.items() if not (unset and value is None)}

    options = [
        Parameter(
            name,
            Parameter.KEYWORD_ONLY,
            default=Parameter.empty if name == required else None if unset else field.default,
            annotation=_described(cls, field, unset),
        )
        for name, field in declared(cls).items()
    ]
    make.__signature__ = Signature(  # type: ignore[attr-defined]
        sorted(options, key=lambda option: option.name != required)
    )
    return make


def in_options(text: str, cls: type[Any]) -> str:
    """Return a text about the fields of a class with the names that their options have."""
    names = declared(cls)
    long = '|'.join(name for name in names if '_' in name)
    found = rf'\b(?:{long})\b|(?<![\d/] )\b(?:{"|".join(names)})(?= = )'
    return re.sub(found, lambda match: '--' + match[0].replace('_', '-'), text)


def _described(cls: type[Any], field: Declared, unset: bool) -> Any:
    """Return the annotation of an option; typer says the default unless it is in the text."""
    choices = ': ' + ', '.join(field.choices) if field.choices else ''
    unit = f' [{field.unit}]' if field.unit else ''
    default = f'{field.default:g}' if isinstance(field.default, float) else str(field.default)
    said = f' (default {default})' if unset else ''
    text = f'{field.description[0].upper()}{field.description[1:]}{choices}{unit}{said}.'
    kind = _KINDS[field.kind]
    words = list(field.choices)
    option = typer.Option(help=in_options(text, cls), autocompletion=lambda: words)
    return Annotated[Optional[kind] if unset else kind, option]


class Log(NamedTuple):
    """Where the signals of a loop are in a log, and which part of it counts [s]."""

    source: 'Source'
    begin: Optional[float]
    end: Optional[float]

    def read(self, paths: Sequence[Path], topics: dict[str, str]) -> 'dict[str, RecordedRun]':
        """Read runs, with other signals by topic or column, and say how files were understood."""
        from nadrc_ros.records.read_run import read_runs

        source = attrs.evolve(self.source, signals={**topics, **self.source.signals})
        with progress(f'reading {paths[0]}' if len(paths) == 1 else f'reading {len(paths)} runs'):
            runs = read_runs(paths, source, self.begin, self.end)
        for run in runs.values():
            if run.told:
                note(f'{run.path}: {run.told}')
        return runs


def log(
    measurement: Annotated[
        str, typer.Option(help='Topic of the measurement in a bag, or its column in a CSV file.')
    ] = '',
    command: Annotated[str, typer.Option(help='The same of the command.')] = '',
    reference: Annotated[
        str, typer.Option(help='The same of the reference, if there is one.')
    ] = '',
    namespace: Annotated[str, typer.Option(help='Namespace of the loop in a bag.')] = '',
    time: Annotated[str, typer.Option(help='Column of the time in a CSV file.')] = '',
    time_unit: Annotated[
        str,
        typer.Option(help='Its unit: s, ms, us, ns, min or h; by default that of its heading.'),
    ] = '',
    begin: Annotated[
        Optional[float],
        typer.Option(
            '--from', help='Use the log from that second on, 0 = first measurement with a command.'
        ),
    ] = None,
    end: Annotated[
        Optional[float], typer.Option('--to', help='Use the log up to that second.')
    ] = None,
) -> Log:
    """Make what a log is read by."""
    from nadrc_ros.records.source import Source

    given = {'measurement': measurement, 'command': command, 'reference': reference}
    signals = {name: value for name, value in given.items() if value}
    source = Source(signals=signals, namespace=namespace, time=time, time_unit=time_unit)
    return Log(source, begin, end)


def changed(whole: 'Scenario', **options: Any) -> 'Scenario':
    """Return the scenario with other values, and say which retunes are left out for that."""
    scenario = whole.changed(**options)
    for retune in whole.retunes:
        if retune not in scenario.retunes:
            note(f'the retune at {retune.time:g} s is after the end of this run')
    return scenario


def check_outputs(
    *,
    out: Optional[Path] = None,
    json: Optional[Path] = None,
    plot: Optional[Path] = None,
    page: Optional[Path] = None,
    table: Optional[Path] = None,
) -> None:
    """Refuse, before any work, a folder or files that cannot be written or end otherwise."""
    from nadrc_ros.atomic import check_file, check_folder

    with reporting():
        if out is not None:
            check_folder(out)
        for option, (path, endings) in {
            '--json': (json, ()),
            '--plot': (plot, _PICTURES),
            '--page': (page, ()),
            '--table': (table, _TABLES),
        }.items():
            if path is None:
                continue
            if endings and path.suffix not in endings:
                said = f'{path} must end in {" or ".join(endings)}'
                raise typer.BadParameter(said, param_hint=option)
            check_file(path)
