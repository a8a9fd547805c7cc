"""`nadrc tune`: bandwidths, b0 and gains of a scenario's controllers by evolutionary search."""

# ruff: noqa: UP045
from pathlib import Path
from typing import Annotated, Any, Optional, TYPE_CHECKING

import attrs
from nadrc_ros.adrc.fields import build
from nadrc_ros.cli.failure import reporting
from nadrc_ros.cli.messages import note, say, warning
from nadrc_ros.cli.options import check_outputs, fields, ScenarioFile, takes
from nadrc_ros.cli.progress import progress
from nadrc_ros.tuning.search.settings import TuneSettings
import typer

if TYPE_CHECKING:
    from nadrc_ros.scenario import Scenario
    from nadrc_ros.scenario.units import Units
    from nadrc_ros.tuning.search.result import Tuned
    from nadrc_ros.tuning.search.study import TuningStudy

_OUT = Path('out/tune')
_MOST_FRONT_ROWS = 12


@takes(values=fields(TuneSettings, unset=True))
def tune(
    file: ScenarioFile,
    values: dict[str, Any],
    controller: Annotated[
        Optional[list[str]], typer.Option(help='Only this controller; may be repeated.')
    ] = None,
    vary: Annotated[
        Optional[list[str]],
        typer.Option(help='Instead of the defaults: NAME or NAME=LOW:HIGH; may be repeated.'),
    ] = None,
    b0_spread: Annotated[
        Optional[str], typer.Option(help='Spread of the input gain of the plant: 0.5:2.')
    ] = None,
    plant: Annotated[
        Optional[list[str]],
        typer.Option(help='Spread of a plant coefficient, a3=0.1:0.3; may be repeated.'),
    ] = None,
    settings: Annotated[
        Optional[Path],
        typer.Option(help='YAML file with the options above, as vary: {b0: [0.5, 2]}.'),
    ] = None,
    isu: Annotated[
        Optional[float], typer.Option(help='Take the best design of the front up to this ISU.')
    ] = None,
    choose: Annotated[
        Optional[int], typer.Option(min=1, help='Take this point of the front, by number.')
    ] = None,
    storage: Annotated[
        Optional[str],
        typer.Option(help='Journal file or database URL of the studies; default: in the folder.'),
    ] = None,
    worker: Annotated[
        int, typer.Option(min=0, help='Number of this machine, if several share a storage.')
    ] = 0,
    jobs: Annotated[
        Optional[int], typer.Option(min=1, help='Runs at once; by default one per core.')
    ] = None,
    out: Annotated[
        Optional[Path], typer.Option(help='Folder for the results; default out/tune/SCENARIO.')
    ] = None,
) -> None:
    """
    Find bandwidths and gains that track well for little effort under noise.

    By default the front of ITAE against ISU and its knee. Writes the tuned scenario, a ROS
    parameter file per controller, tune.json and front.png. After Ctrl-C or a kill the same command
    goes on; when all is done it takes --isu or --choose from what was found.

    Example: nadrc tune motor_speed, or nadrc tune paper --budget 20 --b0-spread 0.7:1.4
    """
    ranges = {'vary': vary, 'plant': plant, 'b0_spread': b0_spread}
    given = values | {key: value for key, value in ranges.items() if value}
    with reporting(file):
        from nadrc_ros.scenario import find_scenario, load

        path = find_scenario(file)
        scenario = _bare(load(path))
    folder = out or _OUT / path.stem
    check_outputs(out=folder)
    if isu is not None and choose is not None:
        raise typer.BadParameter('it excludes --isu', param_hint='--choose')
    with reporting():
        from nadrc_ros.adrc.errors import SettingError

        if isu is not None and not isu > 0.0:
            raise SettingError('isu', isu, 'above 0')
        names = _chosen(scenario, controller)
        tuning = _tuning(given, settings)
        try:
            from nadrc_ros.tuning.search.study import open_storage
        except ImportError as error:
            from nadrc_ros.extras import MissingPackage

            raise MissingPackage('tune', error.name, 'tune') from None
        where = storage or str(folder / 'study.log')
        studies = _studies(scenario, names, tuning, open_storage(where), worker)
    kept = f'the study in {where} is kept; the same command goes on'
    with reporting(after_interrupt=lambda: kept):
        _search(list(studies.values()), jobs)
        _finish(path.stem, scenario, tuning, studies, isu, choose, folder)


def _bare(scenario: 'Scenario') -> 'Scenario':
    """Leave retunes out: what is tuned would be overwritten by them."""
    for retune in scenario.retunes:
        warning(f'the retune at {retune.time:g} s is ignored: it would overwrite what is tuned')
    return attrs.evolve(scenario, retunes=())


def _chosen(scenario: 'Scenario', wanted: Optional[list[str]]) -> list[str]:
    from nadrc_ros.adrc.errors import one_of, SettingError

    for name in wanted or []:
        if name not in scenario.controllers:
            raise SettingError('--controller', name, one_of(name, scenario.controllers))
    names = [name for name in scenario.controllers if name in (wanted or scenario.controllers)]
    for name in names:
        if name == 'scenario':
            raise SettingError(
                'controllers', name, 'named otherwise: scenario.yaml is written too'
            )
    return names


def _tuning(given: dict[str, Any], file: Optional[Path]) -> TuneSettings:
    from nadrc_ros.adrc.errors import SettingError, UserError
    from nadrc_ros.scenario.files import read_text
    from nadrc_ros.yaml_text import read_yaml

    for key in ('vary', 'plant'):
        if key in given:
            given[key] = dict(_named_range(key, text) for text in given[key])
    if 'b0_spread' in given:
        given['b0_spread'] = _range('b0_spread', given['b0_spread'])
    with reporting(str(file or '')):
        content = {} if file is None else read_yaml(read_text(file))
    if not isinstance(content, dict):
        raise SettingError('--settings', str(file), 'a file with a mapping of options to values')
    try:
        return build(TuneSettings, {**content, **given})
    except SettingError as wrong:
        if file is None or wrong.name.partition('.')[0] in given:
            raise
        raise UserError(f'{file}: {wrong}') from None


def _named_range(key: str, text: str) -> tuple[str, Any]:
    name, equals, span = text.partition('=')
    return name, _range(f'{key}.{name}', span) if equals else ()


def _range(name: str, text: str) -> tuple[float, ...]:
    from nadrc_ros.adrc.errors import SettingError

    try:
        low, high = map(float, text.split(':'))
    except ValueError:
        raise SettingError(name, text, 'low:high, two numbers') from None
    return low, high


def _studies(
    scenario: 'Scenario', names: list[str], tuning: TuneSettings, storage: Any, worker: int
) -> 'dict[str, TuningStudy]':
    from nadrc_ros.simulation.simulate import kernel_of
    from nadrc_ros.tuning.search.score import Judge
    from nadrc_ros.tuning.search.study import TuningStudy
    from nadrc_ros.tuning.search.variables import variables

    found = {}
    for name in names:
        experiment = scenario.experiment
        periods = tuning.trials * tuning.seeds * experiment.steps
        fast = kernel_of(experiment, periods, None, note) is not None
        judge = Judge(scenario, name, tuning, fast)
        varied = variables(
            judge.settings, tuning.vary, scenario.rate, scenario.duration, tuning.largest_wh
        )
        assert judge.corners  # refuses a bad end before anything is run
        found[name] = TuningStudy(judge, varied, storage, name, worker)
    if not scenario.noise.variance:
        warning('there is no noise: effort costs little, and bandwidths grow to what is allowed')
    return found


def _search(studies: 'list[TuningStudy]', jobs: Optional[int]) -> None:
    from nadrc_ros.cli.workers import processes, threads
    from nadrc_ros.tuning.search.study import run_studies

    going = [study for study in studies if study.done < study.tuning.trials]
    if not going:
        return
    for study in going:
        if study.total > study.tuning.trials:
            note(
                f'{study.label}: {study.total} designs, not {study.tuning.trials}: the first '
                f'generation has {study.first}, each later one {study.tuning.population}'
            )
    total, done = sum(one.total for one in going), sum(one.done for one in going)
    # Compiled runs need no process each, and one by one they need no other process.
    in_threads = jobs == 1 or all(study.judge.compiled for study in going)
    workers = threads(jobs) if in_threads else processes(jobs)
    with progress('trying designs', total, done) as tell, workers as executor:
        run_studies(going, executor, tell)


def _finish(
    name: str,
    scenario: 'Scenario',
    tuning: TuneSettings,
    studies: 'dict[str, TuningStudy]',
    isu: Optional[float],
    number: Optional[int],
    folder: Path,
) -> None:
    from nadrc_ros.atomic import write_json, write_whole
    from nadrc_ros.report.marks import title_of
    from nadrc_ros.report.style import render
    from nadrc_ros.scenario.parameter_files import about_reference
    from nadrc_ros.tuning.search.picture import draw
    from nadrc_ros.tuning.search.result import document, texts, tuned

    found = [tuned(study, one, isu, number) for one, study in studies.items()]
    title = title_of(name, scenario)
    contents = {key: text.encode() for key, text in texts(scenario, found).items()}
    contents['front.png'] = render(draw(found, title, tuning, scenario.units), 'png')
    folder.mkdir(parents=True, exist_ok=True)
    for file, content in contents.items():
        write_whole(folder / file, content)
    write_json(folder / 'tune.json', 'tune', document(name, tuning, found))
    for one in found:
        _print_front(one, tuning, scenario.units)
    _print_table(title, found, scenario)
    say(f'tuned scenario {folder / "scenario.yaml"}')
    for one in found:
        say(f'ROS parameters {folder / one.name}.yaml')
    for remark in {about_reference(one.settings) for one in found} - {''}:
        note(remark)
    say(f'front {folder / "front.png"}, all numbers {folder / "tune.json"}')


def _print_front(one: 'Tuned', tuning: TuneSettings, units: 'Units') -> None:
    """Print some of the front, the ends and the chosen point among them."""
    from nadrc_ros.cli.table import print_columns, Row
    from nadrc_ros.report.tables import shown_together
    from nadrc_ros.tuning.search.picture import labels
    from rich.text import Text

    heads = [*labels(tuning, units), *(v.name for v in one.varied)]
    last = len(one.front) - 1
    shown = {round(i * last / (_MOST_FRONT_ROWS - 1)) for i in range(_MOST_FRONT_ROWS)} | {
        one.choice.index
    }
    points = [one.front[i] for i in sorted(shown)]
    numbers = [(p.figures.isu, p.figures.objective, *p.values.values()) for p in points]
    whole = [False, False, *(v.whole for v in one.varied)]
    columns = [
        [f'{value:.0f}' for value in column] if each else shown_together('', column, plain=True)
        for column, each in zip(zip(*numbers), whole)
    ]
    rows = []
    for i, texts in zip(sorted(shown), zip(*columns)):
        chosen = i == one.choice.index
        cells = [Text(text, 'bold' if chosen else '') for text in texts]
        rows.append(Row(f'{i + 1} *' if chosen else str(i + 1), '', cells))
    print_columns(f'{one.name}: {one.choice.why} (*)', heads, rows, 'point')


def _print_table(title: str, found: 'list[Tuned]', scenario: 'Scenario') -> None:
    from nadrc_ros.cli.table import print_figures_of_merit

    predicted, settled = {one.name: one.predicted for one in found}, scenario.experiment.settled
    print_figures_of_merit(f'{title}, as tuned', predicted, settled, scenario.units)
