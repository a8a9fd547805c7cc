"""`nadrc commission`: from an unknown machine to a tuned loop, step by step."""

# ruff: noqa: UP045
from contextlib import ExitStack
from pathlib import Path
from signal import default_int_handler, SIG_IGN
from typing import Annotated, Optional, TYPE_CHECKING

from nadrc_ros.cli import options
from nadrc_ros.cli.failure import reporting, USER_ERROR
from nadrc_ros.cli.live import pages_of, wait_for_ctrl_c
from nadrc_ros.cli.messages import note
import typer

if TYPE_CHECKING:
    from nadrc_ros.cli.commission_session import Session
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
        Optional[float],
        typer.Option(min=1.0, help='Longest time of each experiment in seconds; usually 20.'),
    ] = None,
    center: Annotated[
        Optional[float],
        typer.Option(help='Command with which the machine rests; by default safe_command.'),
    ] = None,
    actuator_timeout: Annotated[
        Optional[float],
        typer.Option(
            min=0.0, help='Test whether the actuator stops without commands within this time [s].'
        ),
    ] = None,
    write: Annotated[
        Optional[Path], typer.Option(help='Parameter file for what you accept.')
    ] = None,
    out: Annotated[Path, typer.Option(help='Folder for the report and the parameter file.')] = (
        Path('out/commission')
    ),
    live: Annotated[
        bool,
        typer.Option(
            '--live', help='Serve a page to watch and stop it, see `nadrc live`; until Ctrl-C.'
        ),
    ] = False,
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
    session: Optional[Session] = None

    def unchanged(text: str) -> str:
        return text if session is not None and not session.changed else ''

    def interrupted() -> str:
        return f'the machine is at its safe command{unchanged(", and nothing was changed")}'

    with (
        reporting(
            after_interrupt=interrupted, after_error=lambda: unchanged('Nothing was changed.')
        ),
        ExitStack() as s,
    ):
        try:
            from nadrc_ros.commission.graph_machine import reached
        except ImportError as missing:
            from nadrc_ros.adrc.errors import UserError

            raise UserError(
                f'ROS 2 is not here ({missing}): source it, or use `make demo`'
            ) from None
        from nadrc_ros.cli import commission_session
        from nadrc_ros.commission.rehearsal import controller_of, NAMESPACE
        from nadrc_ros.parameter_file import parameters_in
        from nadrc_ros.ros.runtime import stop_signals_go_to

        out.mkdir(parents=True, exist_ok=True)
        s.enter_context(stop_signals_go_to(default_int_handler))
        ending = s.enter_context(ExitStack())  # a second Ctrl-C must not leave nodes behind
        rehearsal = _rehearsal(plant, out) if plant else None
        if rehearsal is not None:
            controller = f'{NAMESPACE}/controller'
            s.callback(rehearsal.nodes.stop)
            rehearsal.start()
        elif params is not None:
            parameters_in(str(params))  # a mistake in it is told here, not by a node that ends
            s.enter_context(controller_of(params, out))
        asked = {
            'max_command': max_command,
            'travel': travel,
            'speed': speed,
            'longest': longest,
            'center': center,
        }
        if rehearsal is not None:
            asked |= {name: x for name, x in rehearsal.bounds.items() if asked[name] is None}
            if actuator_timeout is None:
                actuator_timeout = rehearsal.actuator_timeout
            owner = [f'--{k.replace("_", "-")} {asked[k]:.3g}' for k in rehearsal.bounds]
            owner.append(f'--actuator-timeout {actuator_timeout:.3g}')
            note(f'its owner says: {" ".join(owner)}')
        s.callback(ending.enter_context, stop_signals_go_to(SIG_IGN))
        started = rehearsal is not None or params is not None
        with reached(controller, note, started) as machine:
            s.enter_context(pages_of([machine.name] if live else []))
            session = commission_session.Session(
                machine, out, write or out / _FILE, yes, rehearsal
            )
            session.actuator_timeout = actuator_timeout
            session.started = params is not None and rehearsal is None
            try:
                session.go(asked)
            finally:
                session.report(machine.name)
        if live:
            wait_for_ctrl_c('the page goes on, and can have control now,')
        if session.refused:
            raise typer.Exit(USER_ERROR)


def _rehearsal(plant: str, out: Path) -> 'Rehearsal':
    from nadrc_ros.commission.rehearsal import Rehearsal
    from nadrc_ros.ros.runtime import private_domain
    from nadrc_ros.scenario import find_scenario, load

    with reporting(f'--plant {plant}'):
        scenario = load(find_scenario(plant))
    private_domain(keep=True)
    note(f'rehearsal: {plant} behind a controller that knows only its limits; nothing is real')
    return Rehearsal(scenario, out / 'nodes')
