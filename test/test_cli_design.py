"""`nadrc design` prints, writes and refuses as a user would want it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.cli.app import app
from nadrc_ros.report.bode import critical, draw_bode, Loop, unwrapped
from nadrc_ros.scenario import load
import numpy as np
import pytest
from typer.testing import CliRunner
import yaml

ASKED = ('--settling-time', 0.5, '--rate', 200, '--noise-std', 1e-4)


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, ['design', *map(str, arguments)])


def test_the_files_load_where_they_are_meant_to(tmp_path: Path) -> None:
    out = tmp_path / 'mine'
    result = nadrc(*ASKED, '--disturbance-frequency', 5, '--b0', -2, '--out', out)
    assert result.exit_code == 0, result.output
    text = result.stdout
    for word in (
        'conventional',
        'nested_2',
        ' *\n',
        'Take ',
        'filtered PID',
        '10 more rows',
    ):
        assert word in text
    assert 'Herbst 2013' not in text and 'Herbst 2013' in nadrc(*ASKED, '--details').stdout
    assert 'if reference/rate and reference/acceleration come too' in ' '.join(
        result.output.split()
    )
    document = json.loads((out / 'design.json').read_text())
    chosen = document['chosen']
    (parameters,) = (node['ros__parameters'] for node in _yaml(out / 'design.yaml').values())
    assert parameters.pop('rate') == 200.0
    settings = ControllerSettings(**parameters)
    scenario = load(out / 'scenario.yaml')
    assert settings == scenario.controllers[chosen] == next(iter(scenario.controllers.values()))
    assert set(scenario.controllers) == set(document['candidates'])
    assert scenario.rate == 200.0 and scenario.plant.make().b0 == -2.0
    assert (out / 'bode.png').read_bytes().startswith(b'\x89PNG')


@pytest.mark.parametrize(
    ('arguments', 'code', 'words'),
    (
        ((), 2, 'settling-time'),
        (('--settling-time', 'soon'), 2, 'settling-time'),
        (('--settling-time', -1), 1, 'error: --settling-time = -1.0: must be'),
        ((*ASKED, '--b0', 0), 1, 'error: --b0 = 0.0: must be'),
        ((*ASKED, '--structure', 'nestled'), 1, "error: --structure = 'nestled': must be one of"),
        ((*ASKED, '--rate', 20), 1, 'possible: a settling time of at least'),
    ),
)
def test_nonsense_and_conflicts_end_with_one_line_and_no_file(
    arguments: tuple[object, ...],
    code: int,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        app(['design', *map(str, arguments), '--out', str(tmp_path / 'never')])
    out, error = capsys.readouterr()
    assert ended.value.code == code
    assert words in out + error
    assert code == 2 or (out == '' and error.count('\n') == 1)
    assert not (tmp_path / 'never').exists()


def test_help_names_every_requirement_with_its_unit() -> None:
    text = nadrc('--help').stdout
    for word in ('--settling-time', '--command-noise', '--half-gain', '[rad/s]', '[Hz]'):
        assert word in text


def test_the_picture_marks_the_margins() -> None:
    """Of L = 4 / (s (s + 1)^2): it is -2 at 1 rad/s, so unstable by a factor of two."""
    omega = np.geomspace(0.1, 10.0, 400)
    loop = np.asarray(4.0 / (1j * omega * (1j * omega + 1.0) ** 2), dtype=np.complex128)
    drawn = Loop(omega, np.abs(loop), np.abs(loop), loop, 1.36, 0.5, (0.0, 0.5))
    ((frequency, size),) = critical(drawn)
    assert (frequency, size) == pytest.approx((1.0, 2.0), rel=1e-3)
    assert unwrapped(drawn)[0] == pytest.approx(-101.4, abs=0.1)
    turned = drawn._replace(loop=drawn.loop / (1j * omega) ** 3, crossover=1.1)
    assert unwrapped(turned)[-1] == pytest.approx(unwrapped(drawn)[-1] + 90.0)
    figure = draw_bode({'mine': drawn}, 'mine', 'title', band=1.0)
    texts = [text.get_text() for axis in figure.axes for text in axis.texts]
    figure.draw_without_rendering()
    labels = [text.get_text() for axis in figure.axes for text in axis.get_xticklabels()]
    labels += [text.get_text() for axis in figure.axes for text in axis.get_yticklabels()]
    assert '10' in labels and '0.1' in labels and not any('$' in label for label in labels)
    assert 'gain × 0.5' in texts and any(text.startswith('phase margin') for text in texts)


def _yaml(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding='utf-8'))
