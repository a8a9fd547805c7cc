"""Pictures: their text is plain, no label covers another, and those in the docs are of today."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
import re
import sys
from types import SimpleNamespace
from typing import Any

from figure_helpers import flaws
from matplotlib.figure import Figure
from nadrc_ros.records.history import Change
from nadrc_ros.report.bode import draw_bode, Loop
from nadrc_ros.report.picture import draw
from nadrc_ros.report.style import plain_log_ticks, render
from nadrc_ros.scenario.units import Units
from nadrc_ros.tuning.search import picture as front
from nadrc_ros.tuning.search.settings import TuneSettings
import numpy as np
import pytest
from svg_helpers import differences

DOCS = Path(__file__).resolve().parents[1] / 'docs'
sys.path.insert(0, str(DOCS))
pictures: Any = import_module('pictures')
TIME = np.linspace(0.0, 9.9, 100)
LONG = ('inner_bandwidth', 'controller_bandwidth', 'command_rate_limit', 'observer_gain_factor')


def trace(k: int, scale: float, known: bool) -> Any:
    wave = scale * np.sin(TIME + k)
    return SimpleNamespace(
        time=TIME,
        reference=scale * np.cos(TIME),
        output=wave,
        command=1e4 * wave,
        disturbance_estimate=wave,
        total_disturbance=wave + 1.0 if known else np.full(100, np.nan),
        measurement_period=0.0,
        color=k,
        path=Path('run'),
        changes=[],
        unit=lambda column: 'V' if column == 'command' else 'm/s',
    )


def loop(gain: float, bandwidth: float) -> Loop:
    omega = np.geomspace(0.1, 3e4, 300)
    s = 1j * omega / bandwidth
    response = np.asarray(gain / (s * (s + 1.0) ** 2), dtype=np.complex128)
    size = np.abs(response)
    return Loop(omega, size, 1.0 / size, response, bandwidth, 0.3, (0.0, 2.0 / gain))


def tuned(name: str, efforts: Any, objectives: Any, chosen: int) -> Any:
    points = [
        SimpleNamespace(figures=SimpleNamespace(isu=x, objective=y))
        for x, y in zip(efforts, objectives)
    ]
    choice = SimpleNamespace(index=chosen, why='least objective, no knee')
    return SimpleNamespace(name=name, front=points, choice=choice)


@pytest.mark.parametrize(
    ('count', 'known', 'scale'),
    [(1, True, 1e-7), (3, False, 1e6), (4, True, 1.0), (12, False, 1e-7)],
)
def test_the_picture_of_runs_can_be_read(count: int, known: bool, scale: float) -> None:
    names = [f'controller_{k}_of_the_$comparison' for k in range(count)]
    drawn = {name: trace(k, scale, known) for k, name in enumerate(names)}
    times = [*(0.4 * k for k in range(10)), 9.0, 9.15, 9.3, 9.9]
    drawn[names[0]].changes = [
        Change(time, '/controller', name, 1.0, 20.0 + time) for time in times for name in LONG
    ]
    figure = draw(drawn, 'a title')
    assert [flaw for flaw in flaws(figure) if '$comparison' not in flaw] == []
    texts = [text.get_text() for text in figure.texts if text.get_text() != 'a title']
    assert any(text.startswith('2 at 0.4 s: inner_bandwidth 20.4') for text in texts)
    assert texts[-1] == 'and 2 more'
    numbers = [text.get_text() for text in figure.axes[0].texts]
    assert numbers == [*map(str, range(1, 11)), '11–13', '14']
    titles = [axes.get_title('left') for axes in figure.axes]
    assert len(titles) == (4 if count > 3 else 3 + count)
    assert ('disturbance estimate − true disturbance [m/s]' in titles) == (count > 3 and known)
    assert titles[2] == 'command u [V]'


def test_more_than_three_controllers_share_a_panel_for_the_error_of_their_estimates() -> None:
    drawn = {str(k): trace(k, 1.0, True) for k in range(4)}
    (*_, axes) = draw(drawn, 'a title').axes
    for line in axes.get_lines():
        np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=float), -1.0)


def test_what_was_not_recorded_is_said() -> None:
    drawn = trace(0, 1.0, False)
    drawn.disturbance_estimate = drawn.total_disturbance
    *others, last = draw({'it': drawn}, 'a title').axes
    assert [text.get_text() for text in last.texts] == ['not recorded']
    assert not any(axes.texts for axes in others)


def test_bode_plots_can_be_read() -> None:
    loops = {f'nested_{k}': loop(1e-6 * k, 30.0 * k) for k in (1, 2, 3)}
    figure = draw_bode(loops, 'nested_2', 'a title', band=8.0)
    assert flaws(figure) == []
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ['nested_1', 'nested_2, chosen', 'nested_3']


@pytest.mark.parametrize(('width', 'size'), [(0.01, 1), (0.01, 80), (0.3, 5), (1e5, 80)])
def test_a_front_can_be_read(width: float, size: int) -> None:
    share = np.linspace(0.0, 1.0, size)
    efforts, values = 400.0 * (1.0 + width) ** share, 7.0 * 0.1**share
    found = [tuned('one', efforts, values, size // 2), tuned('two', efforts, 1.5 * values, 0)]
    found.append(tuned('three', 400.0 * (1.0 + width) ** np.array([0.0, 1.0]), (9.0, 0.7), 0))
    figure = front.draw(found, 'a title', TuneSettings(), Units(output='rad'))
    assert flaws(figure) == []
    (axes,) = figure.axes
    assert ('its whole width is' in axes.get_xlabel()) == (width < 0.1)
    numbers = {text.get_text() for text in axes.texts}
    assert {str(size // 2 + 1), '1'} <= numbers <= {str(i + 1) for i in range(max(size, 2))}
    _, labels = axes.get_legend_handles_labels()
    assert figure.axes[0].get_ylabel().startswith('ITAE [rad·s²]')
    assert labels[0] == f'one: point {size // 2 + 1}, least objective, no knee'


def test_the_ticks_of_a_logarithmic_axis_are_plain_or_powers_all_of_them() -> None:
    for low, high, expected in (
        (0.01, 100.0, {'0.01', '1', '100'}),
        (1e-6, 1.0, {'10⁻⁶', '10⁻⁴', '10⁰'}),
        (2e7, 9e8, {'10⁸'}),
    ):
        figure = Figure()
        axes = figure.subplots()
        axes.set_yscale('log')
        axes.set_ylim(low, high)
        plain_log_ticks(axes)
        figure.draw_without_rendering()
        assert expected <= {text.get_text() for text in axes.get_yticklabels()}


def test_flaws_are_found() -> None:
    figure = Figure()
    axes = figure.subplots()
    axes.set_yscale('log')
    axes.set_ylim(1e-6, 1.0)
    figure.text(0.5, 0.5, 'here')
    figure.text(0.51, 0.5, 'and here')
    figure.text(0.99, 0.1, 'out of it')
    axes.step([0.0, 1.0], [1e-3, 1e-3], label='one')
    axes.legend(loc='center')
    found = flaws(figure)
    assert any(flaw.startswith('markup: $\\mathdefault') for flaw in found)
    assert 'cut off: out of it' in found
    assert any(flaw.startswith('here covers and here') for flaw in found)
    assert 'one is crossed by line one' in found


@pytest.mark.parametrize('name', pictures.NAMES)
def test_a_picture_of_the_docs_shows_the_runs_of_today(name: str) -> None:
    drawn = (DOCS / f'{name}.svg').read_text(encoding='utf-8')
    figure = pictures.figure(name)
    assert flaws(figure) == []
    again = pictures.svg(figure).decode()
    assert drawn == again or differences(drawn, again) == [], f'python docs/pictures.py {name}'


def test_every_scenario_of_a_page_is_drawn() -> None:
    assert {path.stem for path in pictures.SCENARIOS.glob('*.yaml')} == set(pictures.PAGES)


def test_a_difference_of_pictures_is_found() -> None:
    drawn = (DOCS / 'delay.svg').read_text(encoding='utf-8')
    assert differences(drawn, drawn) == []
    assert set(differences(drawn, drawn.replace('time [s]', 'time'))) == {
        "text 'time [s]' on one side only",
        "text 'time' on one side only",
    }
    (line,) = re.findall(r'<g id="line 0 1">\s*<path d="(.*?)"', drawn, re.DOTALL)
    first = line.split('\n', 1)[0]
    x, y = map(float, first[2:].split())
    moved = drawn.replace(line, line.replace(first, f'M {x} {y + 2.0}', 1))
    (found,) = differences(drawn, moved)
    assert re.match(r'line 0 1 is off by 0.0\d+ of its panel', found)


def test_a_picture_is_the_same_bytes_each_time_and_its_text_is_text() -> None:
    figure = draw({'it': trace(0, 1.0, True)}, 'a title')
    for file_format in ('svg', 'png'):
        assert render(figure, file_format) == render(figure, file_format)
    assert '>a title</text>' in render(figure, 'svg').decode()
