"""`nadrc commission` on a simulated machine: what it asks, says, writes and leaves as it was."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli.commission_session import Session
from nadrc_ros.parameter_file import parameters_in
from nadrc_ros.tuning.commission.machine import Simulated
from nadrc_ros.tuning.commission.model import Model, ModelPlant
import pytest

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


def test_what_is_accepted_is_written_before_it_is_set(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file)
    made.go(BOUNDS)
    made.report()
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
    monkeypatch.setattr('sys.stdin.isatty', lambda: True, raising=False)
    made = session(file, yes=False)
    made.go(BOUNDS)
    machine: Any = made.machine
    assert machine.set == {} and not file.exists()
    assert refused in asked[-1]
    assert 'nothing was changed' in capsys.readouterr().out
    made.report()


def test_bounds_are_asked_for_and_never_guessed(file: Path) -> None:
    for name in ('travel', 'speed'):
        with pytest.raises(UserError, match=f'--{name} is needed'):
            session(file).go({**BOUNDS, name: None})


def test_a_refusal_says_why_and_changes_nothing(
    file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = session(file, b0=1e-6)
    made.go({**BOUNDS, 'longest': 5.0})
    machine: Any = made.machine
    assert made.refused and machine.set == {} and not file.exists()
    told = capsys.readouterr()
    assert 'error: Nothing moved' in told.err and 'Nothing was changed' in told.out
