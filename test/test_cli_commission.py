"""`nadrc commission` on a simulated machine: what it asks, says, writes and leaves as it was."""

from __future__ import annotations

from contextlib import nullcontext
from math import inf
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli.app import app
from nadrc_ros.cli.commission_session import Session
from nadrc_ros.commission import graph_machine
from nadrc_ros.parameter_file import parameters_in
from nadrc_ros.tuning.commission.machine import Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
import pytest
from typer.testing import CliRunner

RATE, NOISE = 100.0, 0.02
BOUNDS: dict[str, Any] = {
    'max_command': 4.0,
    'travel': 3.0,
    'speed': 8.0,
    'longest': 20.0,
    'center': None,
}
QUESTIONS = ('these pulses?', 'Send them?', 'Try them?', 'parameters?')


class Machine(Simulated):
    """A machine of order 1 with b0 = 2, behind a controller that is not on any graph."""

    name = '/arm/controller'
    enabled = False
    writers: tuple[str, ...] = ()
    sensors: tuple[str, ...] = ('/arm/encoder',)

    def __init__(self, file: Path, b0: float = 2.0) -> None:
        model = Model(order=1, b0=b0, damping=1.0)
        present = ControllerSettings(plant_order=1, command_min=-10.0, command_max=10.0)
        super().__init__(ModelPlant(model, 1.0 / RATE, 0.0, NOISE, 1), RATE, present)
        self.values = {name: getattr(present, name) for name in declared(ControllerSettings)}
        self.values |= {'rate': RATE, 'qos_overrides./command.depth': 1}
        self.topics = {'measurement': '/arm/measurement', 'command': '/arm/command'}
        self.file = file
        self.set: dict[str, Any] = {}
        self.progress: Any = None

    def set_all(self, values: dict[str, Any]) -> str:
        """Take parameters, which are in the file by then."""
        assert self.file.exists()
        self.set = values
        return ''


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'arm.yaml'


def session(file: Path, yes: bool = True, **more: Any) -> Session:
    machine: Any = Machine(file, **more)
    return Session(machine, file.parent, file, yes, None)


def test_a_measurement_of_two_sensors_is_refused_by_their_names(file: Path) -> None:
    made = session(file)
    two: Any = made.machine
    two.sensors = '/arm/encoder', '/arm/plant'
    with pytest.raises(UserError, match='has 2 publishers, /arm/encoder, /arm/plant: stop all'):
        made.go(BOUNDS)


def test_what_is_accepted_is_written_before_it_is_set(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file)
    made.go(BOUNDS)
    made.report(made.machine.name)
    machine: Any = made.machine
    assert 1.8 < machine.set['b0'] < 2.2
    (written,) = parameters_in(str(file)).values()
    assert {name: written[name] for name in machine.set} == machine.set
    assert written['command_max'] == 10.0 and written['rate'] == RATE
    assert not any(name.startswith('qos') for name in written)
    said = capsys.readouterr().out
    assert 'b0: 1 -> ' in said and 'A step of' in said
    assert 'ros2 service call /arm/controller/enable' in said
    page = (file.parent / 'commission.html').read_text(encoding='utf-8')
    assert all(f'<h2>{step}</h2>' in page for step in ('Look', 'Nudge', 'Excite', 'Say', 'Try'))


@pytest.mark.parametrize('refused', QUESTIONS)
def test_who_says_no_has_changed_nothing(
    refused: str, file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked: list[str] = []

    def answer(question: str, default: bool = False) -> bool:
        assert default is False
        asked.append(question)
        return refused not in question

    monkeypatch.setattr('typer.confirm', answer)
    monkeypatch.setattr('typer.prompt', lambda *_, default, **__: default)
    monkeypatch.setattr('sys.stdin.isatty', lambda: True, raising=False)
    made = session(file, yes=False)
    made.go(BOUNDS)
    machine: Any = made.machine
    assert machine.set == {} and not file.exists()
    assert refused in asked[-1]
    assert 'nothing was changed' in capsys.readouterr().out
    made.report(made.machine.name)


@pytest.mark.parametrize('back', [True, False])
def test_a_machine_that_went_away_is_waited_for(
    back: bool, file: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file, yes=False)
    machine: Any = made.machine
    plant = machine.plant
    asked: list[str] = []

    def answer(question: str, default: bool = False) -> bool:
        asked.append(question)
        if question == 'Send them?':
            plant._y = 2.0
        if not question.startswith('Is it back?'):
            return not question.startswith('Close the loop')
        plant._y = 0.0 if back else plant._y
        return back

    monkeypatch.setattr('typer.confirm', answer)
    monkeypatch.setattr('typer.prompt', lambda *_, default, **__: default)
    monkeypatch.setattr('sys.stdin.isatty', lambda: True, raising=False)
    made.go(BOUNDS)
    assert sum(question.startswith('Is it back?') for question in asked) == 1
    assert bool(machine.set) == back and made.refused == (not back)
    assert 'Bring the machine back: it is +1.' in ' '.join(capsys.readouterr().err.split())


def test_bounds_are_asked_for_and_never_guessed(file: Path) -> None:
    for name in ('travel', 'speed'):
        with pytest.raises(UserError, match=f'--{name} is needed'):
            session(file).go({**BOUNDS, name: None})


@pytest.mark.parametrize('really', [0.2, inf])
def test_the_timeout_of_an_actuator_is_tested_where_it_is_given(
    really: float, file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file)
    made.actuator_timeout = 0.3
    machine: Any = made.machine
    machine.actuator_timeout = really
    made.go(BOUNDS)
    made.report(made.machine.name)
    told = capsys.readouterr()
    assert machine.set, told.err
    page = (file.parent / 'commission.html').read_text(encoding='utf-8')
    said = 'stopped after 0.2' if really < inf else 'it does not stop'
    assert said in ' '.join(told.out.split()) and said in page
    assert ('the last command stays' in ' '.join(told.err.split())) == (really == inf)


def test_a_refusal_says_why_and_changes_nothing(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file, b0=1e-6)
    made.go({**BOUNDS, 'longest': 5.0})
    machine: Any = made.machine
    assert made.refused and machine.set == {} and not file.exists()
    told = capsys.readouterr()
    assert 'error: Nothing moved' in told.err and 'Nothing was changed' in told.out


@pytest.mark.parametrize(
    ('end', 'code', 'said'),
    [
        (UserError('a heartbeat stopped'), 1, 'a heartbeat stopped Nothing was changed.'),
        (KeyboardInterrupt(), 130, 'at its safe command, and nothing was changed'),
        (None, 1, 'the node refuses them, and keeps what it has: no'),
    ],
)
def test_what_ends_it_says_whether_anything_was_changed(
    end: BaseException | None,
    code: int,
    said: str,
    file: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    machine: Any = Machine(file)

    def fail(*_: Any) -> Any:
        if end is not None:
            raise end
        return 'no'

    monkeypatch.setattr(machine, 'set_all' if end is None else 'run', fail)
    monkeypatch.setattr(graph_machine, 'reached', lambda *_: nullcontext(machine))
    bounds = [f'--{k.replace("_", "-")}={v}' for k, v in BOUNDS.items() if v is not None]
    words = ['commission', '--yes', *bounds, f'--out={file.parent}', f'--write={file}']
    done = CliRunner().invoke(app, words)
    told = ' '.join(done.output.split())
    assert done.exit_code == code and said in told
    assert ('othing was changed' in told) == (end is not None) != file.exists()


def test_what_was_typed_is_named_before_anything_starts(tmp_path: Path) -> None:
    for words, said in (
        (('--plant', 'moter_speed'), '--plant moter_speed: there is no such file'),
        (('--params', str(tmp_path / 'no.yaml')), f'{tmp_path / "no.yaml"}: cannot be read'),
    ):
        done = CliRunner().invoke(app, ['commission', *words, '--out', str(tmp_path)])
        assert done.exit_code == 1 and f'error: {said}' in ' '.join(done.output.split())
