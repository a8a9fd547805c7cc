"""`nadrc export`: a controller as C for a machine without ROS."""

# ruff: noqa: UP045
from pathlib import Path
import re
from typing import Annotated, Any, Optional, TYPE_CHECKING

from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import say, warning
from nadrc_ros.cli.options import check_outputs
import typer

if TYPE_CHECKING:
    from nadrc_ros.adrc.settings import ControllerSettings

# What else a controller node is told, which is of ROS and no part of the law.
OF_THE_NODE = (
    *('rate', 'pacing', 'steps', 'readers', 'start_timeout', 'lockstep_timeout', 'realtime'),
    *('trigger', 'reference_from', 'enabled_at_start', 'share_command', 'estimate_divisor'),
    *('trace', 'use_sim_time', 'start_type_description_service'),
)
_OF_TOPICS = ('wiring.', 'qos_overrides.')
# What a node may be told that an export does not do: what it must be, and why.
_REFUSED = {
    'reference_from': (
        '',
        "'': export each loop of a cascade, and hand the command over",
    ),
    'enabled_at_start': (True, 'true: call the enable function with false after init'),
}
_NAME = re.compile('[a-z][a-z0-9_]*')
# Files of the export, and of C, that one of that name would be in the place of.
_TAKEN = 'self_test', 'test_vectors', 'float', 'math', 'stdbool', 'stddef', 'stdio', 'string'


def export(
    language: Annotated[str, typer.Argument(help='c, for C99.')],
    file: Annotated[
        str,
        typer.Argument(help='Parameter file of a controller node; or a scenario, or its name.'),
    ],
    out: Annotated[Path, typer.Option(help='Folder for the C files and their README.md.')],
    rate: Annotated[
        Optional[float],
        typer.Option(help='Calls per second, all at one distance; by default as in the file.'),
    ] = None,
    measured_dt: Annotated[
        bool, typer.Option('--measured-dt', help='Hand the time of each step over instead.')
    ] = False,
    single: Annotated[
        bool, typer.Option('--float', help='Compute in single precision, and print its error.')
    ] = False,
    node: Annotated[
        str, typer.Option(help='Which node of the file, or controller of the scenario.')
    ] = '',
    name: Annotated[
        str, typer.Option(help='Prefix of the names of files and functions.')
    ] = 'nadrc',
) -> None:
    """
    Write a controller as C with the same bits: two files without malloc, globals or libm.

    With test vectors and the program that runs them: on your machine, with your compiler. How to
    build and call it: docs/export.md.

    Example: nadrc export c my_robot.yaml --out firmware/yaw --rate 1000
    """
    if language != 'c':
        raise typer.BadParameter(f'{language}: must be c', param_hint='language')
    if measured_dt and rate is not None:
        raise typer.BadParameter('either this or --rate', param_hint='--measured-dt')
    if not _NAME.fullmatch(name):
        raise typer.BadParameter(
            f'{name}: lower-case letters, digits and _, no digit first', param_hint='--name'
        )
    if name in _TAKEN:
        raise typer.BadParameter(f'{name}: {name}.h is another file', param_hint='--name')
    check_outputs(out=out)
    with reporting(file):
        settings, own_rate = _settings(file, node)
    with reporting():
        from nadrc_ros.adrc.errors import UserError
        from nadrc_ros.atomic import write_whole
        from nadrc_ros.export.files import Export

        if not measured_dt and rate is None and own_rate is None:
            raise UserError('there is no rate in the file: give --rate or --measured-dt')
        made = Export(
            settings=settings,
            rate=None if measured_dt else own_rate if rate is None else rate,
            single=single,
            name=name,
        )
        texts = made.files()
        out.mkdir(parents=True, exist_ok=True)
        for path, text in texts.items():
            write_whole(out / path, text.encode())
    for line in made.about()[:-2]:
        say(line)
    say(f'Written to {out}: {", ".join(texts)}. How to build and call it: README.md.')
    if made.warning:
        warning(made.warning)


def _settings(file: str, node: str) -> 'tuple[ControllerSettings, Optional[float]]':
    """Return the settings of a controller, and the rate of the loop if the file has it."""
    from nadrc_ros.adrc.errors import UserError
    from nadrc_ros.adrc.fields import build
    from nadrc_ros.adrc.settings import ControllerSettings
    from nadrc_ros.parameter_file import in_force, parameters_in, VALUES

    path = Path(file)
    if not path.is_file() or VALUES not in path.read_text(encoding='utf-8', errors='replace'):
        return _of_scenario(file, node)
    nodes = in_force(parameters_in(file))
    others = '/plant', '/reference', '/recorder'
    values = dict(_chosen(node, {k: v for k, v in nodes.items() if not k.endswith(others)}))
    for key, (allowed, words) in _REFUSED.items():
        if values.get(key, allowed) != allowed:
            raise UserError(f'{key} = {values[key]!r}: must be {words}')
    rate = values.get('rate')
    law = {
        key: value
        for key, value in values.items()
        if key not in OF_THE_NODE and not key.startswith(_OF_TOPICS)
    }
    if rate is not None and (isinstance(rate, bool) or not isinstance(rate, (int, float))):
        raise UserError(f'rate = {rate!r}: must be a finite number')
    return build(ControllerSettings, law), rate


def _of_scenario(file: str, name: str) -> 'tuple[ControllerSettings, float]':
    from nadrc_ros.adrc.cascade import loops_of
    from nadrc_ros.adrc.errors import UserError
    from nadrc_ros.scenario import find_scenario, load

    scenario = load(find_scenario(file))
    settings = _chosen(name, scenario.controllers)
    if len(loops_of(settings)) > 1:
        raise UserError('it is a cascade: export each of its loops from a parameter file')
    return settings, scenario.rate


def _chosen(name: str, there: 'dict[str, Any]') -> Any:
    """Return the one of that name, or the only one; a name may be a part of the full one."""
    from nadrc_ros.adrc.errors import did_you_mean, UserError

    if not there:
        raise UserError('there is no controller in it')
    found = [key for key in there if not name or name in (key, *key.split('/'))]
    if len(found) == 1:
        return there[found[0]]
    if not found:
        raise UserError(f'--node {name}: there is none of that name; {did_you_mean(name, there)}')
    raise UserError(f'say which with --node: there are {", ".join(found)}')
