"""`nadrc fields` and `nadrc wire`: the numbers in messages, and what a wiring makes of them."""

# ruff: noqa: UP045
from pathlib import Path
import sys
from typing import Annotated, Optional, TYPE_CHECKING

from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import error, say
from nadrc_ros.terminal import columns
import typer

if TYPE_CHECKING:
    from nadrc_ros.ros.wire_check import Heard


# A value, with the gap before it.
_VALUE = 14


def fields(
    where: Annotated[str, typer.Argument(help='A topic of the running graph, or a rosbag2 bag.')],
    topic: Annotated[
        Optional[str], typer.Argument(help='The topic in a bag; by default all of them.')
    ] = None,
    wait: Annotated[float, typer.Option(min=0.1, help='Longest wait for a message [s].')] = 5.0,
) -> None:
    """
    List every number in the messages of a topic, as an address with its present value.

    An address is what wiring.measurement and the like of a controller take, and --measurement
    and the like of identify and report. Of a bag the first message of each topic counts.

    Example: nadrc fields /joint_states, or nadrc fields my_bag /odom
    """
    with reporting(where):
        from nadrc_ros.records.bags import fields_in, is_bag

        path = Path(where)
        if path.exists() and is_bag(path):
            for name, kind, numbers in fields_in(path, topic or ''):
                _print(name, kind, numbers)
            return
        if topic is not None:
            raise typer.BadParameter('a topic of its own is for a bag', param_hint='topic')
    with reporting():  # what is wrong on the graph names its topic by itself
        from nadrc_ros.ros.wire_check import fields_now

        kind, numbers = fields_now(where, wait)
        _print(where, kind, numbers)


def _print(topic: str, kind: str, numbers: list[tuple[str, float]]) -> None:
    begin = f'{topic} {kind} '
    longest = max((len(field) for field, _ in numbers), default=0)
    room = columns(sys.stdout)
    if room is not None and len(begin) + longest + _VALUE > room:
        typer.echo(begin)  # what all addresses begin with, which breaks at its blank only
        begin, longest = '  ', min(longest, room - _VALUE - 2)
    for field, value in numbers:
        typer.echo(f'{begin}{field:{longest}}  {value:>12.6g}')


def wire(
    check: Annotated[
        Path, typer.Option(help='Parameter file of the controllers that are to be checked.')
    ],
    namespace: Annotated[
        str, typer.Option(help='Where a controller of /** is, whose topics are relative.')
    ] = '',
    seconds: Annotated[float, typer.Option(min=0.1, help='How long to listen [s].')] = 2.0,
) -> None:
    """
    Say what each signal of a controller would be now, against the running graph.

    With its address, value and rate, the age of its stamps, and who publishes it. Nothing is
    sent. Exit code 1 if a signal would not come.

    Example: nadrc wire --check arm.yaml
    """
    with reporting():
        from nadrc_ros.parameter_file import in_force, parameters_in

        in_the_file = in_force(parameters_in(str(check)))
    with reporting(str(check)):
        from nadrc_ros.adrc.errors import UserError
        from nadrc_ros.ros.wire_check import check_wiring

        nodes = {
            key: values
            for key, values in in_the_file.items()
            if key.endswith(('/controller', '/*', '/**'))
            or any(name.startswith('wiring.') for name in values)
        }
        if not nodes:
            raise UserError('there is no controller in it')
        wrong = 0
        for key, values in nodes.items():
            home = key.rpartition('/')[0]
            space = namespace if '*' in home or not home else home
            say(f'{key}' + (f' in {space}' if '*' in home and space else ''))
            for heard in check_wiring(values, space, seconds):
                for line in _lines(heard):
                    say(line, ' ' * 6)
                wrong += bool(heard.wrong)
    if wrong:
        error(f'{check}: {wrong} signal{"s" if wrong > 1 else ""} would not come')
        raise typer.Exit(1)


def _lines(heard: 'Heard') -> list[str]:
    who = ', '.join(heard.who) or 'nobody'
    said = [f'  {heard.signal}: {heard.address}']
    if heard.times:
        said.append(
            f'    {heard.value:.6g} at {heard.rate:.4g} Hz, {1e3 * heard.age:.3g} ms old, '
            f'from {who}'
        )
    elif heard.taken and not heard.wrong:
        said.append(f'    {who} takes it, and nobody publishes it yet')
    if heard.wrong:
        said.append(
            f'    {heard.wrong}' + (f', from {who}' if heard.who and not heard.times else '')
        )
    return said
