"""Options that several commands have, and those that set declared fields, described by these."""

# ruff: noqa: UP045
from typing import Annotated, Any, Optional, TYPE_CHECKING

from nadrc_ros.adrc.fields import Declared
import typer

if TYPE_CHECKING:
    from nadrc_ros.records.source import Source

# Where the signals of a loop are in a log that is not the recorder's.
Measurement = Annotated[
    str, typer.Option(help='Topic of the measurement in a bag, or its column in a CSV file.')
]
Command = Annotated[str, typer.Option(help='The same of the command.')]
Reference = Annotated[str, typer.Option(help='The same of the reference, if there is one.')]
Namespace = Annotated[str, typer.Option(help='Namespace of the loop in a bag.')]
Time = Annotated[str, typer.Option(help='Column of the time in a CSV file.')]
TimeUnit = Annotated[
    str, typer.Option(help='Its unit: s, ms, us, ns, min or h; by default that of its heading.')
]
# Which part of a log counts, in seconds of its own time.
From = Annotated[
    Optional[float],
    typer.Option(
        '--from', help='Use the log from that second on, 0 = first measurement with a command.'
    ),
]
To = Annotated[Optional[float], typer.Option('--to', help='Use the log up to that second.')]


def source(namespace: str, time: str, time_unit: str, **signals: str) -> 'Source':
    """Return where the signals are that the options name; an empty one was not given."""
    from nadrc_ros.records.source import Source

    named = {name: value for name, value in signals.items() if value}
    return Source(signals=named, namespace=namespace, time=time, time_unit=time_unit)


def option(field: Declared, default: str = '') -> Any:
    """Return the option that sets a field; typer says the default unless it is given in words."""
    choices = ': ' + ', '.join(field.choices) if field.choices else ''
    unit = f' [{field.unit}]' if field.unit else ''
    said = f' (default {default})' if default else ''
    text = f'{field.description[0].upper()}{field.description[1:]}{choices}{unit}{said}.'
    return typer.Option(help=text.replace('[', '\\['))
