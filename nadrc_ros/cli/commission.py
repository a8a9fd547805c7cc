"""`nadrc commission`: from an unknown machine to a tuned loop, step by step."""

# ruff: noqa: UP045
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated, Optional, TYPE_CHECKING

from nadrc_ros.cli import options
from nadrc_ros.cli.failure import reporting, USER_ERROR
from nadrc_ros.cli.messages import note
import typer

if TYPE_CHECKING:
    from nadrc_ros.commission.rehearsal import Rehearsal

_FILE = 'commissioned.yaml'


def commission(
    controller: Annotated[
        str, typer.Option(help='The controller node; by default the only one there is.')
    ] = '',
    params: Annotated[
        Optional[Path], typer.Option(help='Start a controller node with this parameter file.')
    ] = None,
    plant: Annotated[
        str,
        typer.Option(
            help='Rehearse on the plant of a scenario, as motor_speed, whose truth is hidden.'
        ),
    ] = '',
    max_command: Annotated[
        Optional[float], typer.Option(help='Farthest that the command goes from --center.')
    ] = None,
    travel: Annotated[
        Optional[float], typer.Option(help='Farthest that the output goes from where it is.')
    ] = None,
    speed: Annotated[
        Optional[float], typer.Option(help='Largest rate of change of the output, per second.')
    ] = None,
    longest: Annotated[
        float, typer.Option(min=1.0, help='Longest time of each experiment in seconds.')
    ] = 20.0,
    center: Annotated[
        Optional[float],
        typer.Option(help='Command with which the machine rests; by default safe_command.'),
    ] = None,
    actuator_timeout: Annotated[
        Optional[float],
        typer.Option(min=0.0, help='Time after which the actuator stops without commands [s].'),
    ] = None,
    write: Annotated[
        Optional[Path], typer.Option(help='Parameter file for what you accept.')
    ] = None,
    out: Annotated[Path, typer.Option(help='Folder for the report and the parameter file.')] = (
        Path('out/commission')
    ),
    yes: Annotated[bool, typer.Option('--yes', help='Answer every question with yes.')] = False,
) -> None:
    """
    Find order, b0 and bandwidths of an unknown machine, safely, with its controller node.

    The loop has to be disabled. Five steps are explained and asked for: look, nudge, excite, say,
    try. No parameter changes until you accept; the machine stops when this program ends.

    Example: nadrc commission --plant motor_speed, or
    nadrc commission --controller /arm/controller --max-command 2 --travel 0.3 --speed 2
    """
    options.check_outputs(out=out)
    with reporting(after_interrupt=lambda: 'the machine is at its safe command'), ExitStack() as s:
        try:
            from nadrc_ros.commission.graph_machine import reached
        except ImportError as missing:
            from nadrc_ros.adrc.errors import UserError

            raise UserError(
                f'ROS 2 is not here ({missing}): source it, or use `make demo`'
            ) from None
        from nadrc_ros.cli.commission_session import Session
        from nadrc_ros.commission.rehearsal import controller_of, NAMESPACE

        out.mkdir(parents=True, exist_ok=True)
        rehearsal = _rehearsal(plant, out) if plant else None
        if rehearsal is not None:
            controller = f'{NAMESPACE}/controller'
            s.callback(rehearsal.nodes.stop)
            rehearsal.start()
        elif params is not None:
            s.enter_context(controller_of(params, out))
        machine = s.enter_context(reached(controller))
        asked = {
            'max_command': max_command,
            'travel': travel,
            'speed': speed,
            'longest': longest,
            'center': center,
        }
        session = Session(machine, out, write or out / _FILE, yes, rehearsal)
        session.actuator_timeout = actuator_timeout
        try:
            session.go(asked)
        finally:
            session.report()
        if session.refused:
            raise typer.Exit(USER_ERROR)


def _rehearsal(plant: str, out: Path) -> 'Rehearsal':
    from nadrc_ros.commission.rehearsal import Rehearsal
    from nadrc_ros.ros.runtime import private_domain
    from nadrc_ros.scenario import find_scenario, load

    private_domain(keep=True)
    note(f'rehearsal: {plant} behind a controller that knows only its limits; nothing is real')
    return Rehearsal(load(find_scenario(plant)), out / 'nodes')
