"""Records of angles: the error is the short one, and nothing is drawn where a sensor wraps."""

from __future__ import annotations

from math import pi
from pathlib import Path

import attrs
from nadrc_ros.adrc.angle import short
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.records.angles import unwrapped
from nadrc_ros.records.figures import Figures
from nadrc_ros.records.history import about_figures, append_parameters, History, read_history
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recording import RunFolder, RunSettings
from nadrc_ros.records.rows import Rows
from nadrc_ros.records.simulated import recorded as as_recorded
from nadrc_ros.report.picture import draw
from nadrc_ros.report.traces import trace_of
from nadrc_ros.scenario import loads
import numpy as np
import pytest
from test_angle import SCENARIO

TURN = 2.0 * pi
T = 0.01 * np.arange(800)
TURNING = 3.0 * T + 0.3 * np.sin(T)
REFERENCE = 3.0 * T + 0.5
COLUMNS = {
    'time': T,
    'reference': (REFERENCE + pi) % TURN - pi,
    'measurement': (TURNING + pi) % TURN - pi,
    'command': np.sin(T),
}
TOLD = attrs.asdict(ControllerSettings(measurement_period=TURN))


def recorded(directory: Path, period: float = 0.0) -> Path:
    folder = RunFolder(directory, list(COLUMNS), RunSettings(measurement_period=period))
    for row in zip(*COLUMNS.values()):
        folder.write(list(map(float, row)))
    folder.close()
    return folder.path


@pytest.mark.parametrize('told_at', (0, 300, None))
def test_the_error_is_the_short_one_whenever_the_period_is_told(told_at: int | None) -> None:
    history = History()
    told = 0.0 if told_at is not None else TURN
    found = Figures(RunSettings(measurement_period=told, settle_time=1.0), history)
    for k, row in enumerate(zip(*COLUMNS.values())):
        if k == told_at:
            history.take(None, '/controller', about_figures(TOLD))
        found.add(float(row[0]), dict(zip(COLUMNS, map(float, row))))
    found.end()
    errors = REFERENCE - TURNING
    assert found.values().max_error == pytest.approx(abs(errors).max())
    assert found.values().peak_error == pytest.approx(abs(errors[100:]).max())
    assert found.values().ise == pytest.approx(0.01 * (errors**2).sum())


def test_without_a_controller_that_tells_a_period_errors_are_as_they_are() -> None:
    history = History()
    line = {name: value for name, value in TOLD.items() if name != 'measurement_period'}
    history.take(None, '/controller', line)  # of an earlier version
    assert History().measurement_period() is None and history.measurement_period() == 0.0
    found = Figures(RunSettings(), history)
    for row in zip(*COLUMNS.values()):
        found.add(float(row[0]), dict(zip(COLUMNS, map(float, row))))
    assert found.values().max_error > pi


def test_a_recorded_angle_is_read_with_short_errors_and_drawn_as_it_turned(tmp_path: Path) -> None:
    path = recorded(tmp_path)
    append_parameters(path, None, '/controller', TOLD)
    run = read_run(path)
    assert run.measurement_period == TURN == read_history(path).measurement_period()
    np.testing.assert_allclose(run.error, REFERENCE - TURNING, atol=1e-12)
    assert run.metrics.max_error == pytest.approx(abs(run.error).max(), abs=1e-12)
    figure = draw({'it': run}, 'title')
    plotted = trace_of(run.unwrapped()).columns
    lines = [line.get_ydata() for line in figure.axes[0].get_lines()[:2]]
    for line in (*lines, plotted['output'], plotted['reference']):
        values = np.asarray(line, dtype=float)
        assert len(values) > 100 and abs(np.diff(values)).max() < 0.1
    assert read_run(recorded(tmp_path, TURN)).measurement_period == TURN


def test_a_simulated_angle_is_drawn_as_it_turned() -> None:
    scenario = loads(SCENARIO)
    result = scenario.run('angle')
    drawn = as_recorded(Path('it'), scenario, 'angle', result)
    lines = draw({'angle': drawn}, 'title').axes[0].get_lines()[:2]
    output, reference = (np.asarray(line.get_ydata(), dtype=float) for line in lines)
    np.testing.assert_allclose(output, result.output)
    assert abs(reference - output).max() <= 180.0 + 1e-9
    assert abs(np.diff(reference)).max() < 20.0


def test_a_reference_between_two_samples_goes_the_short_way() -> None:
    for period in (0.0, TURN):
        rows = Rows(['measurement', 'command', 'reference'])
        rows.period = period
        for k, value in enumerate(COLUMNS['reference'][:300].tolist()):
            time = k * 10_000_000
            rows.take('reference', time + 5_000_000, value)
            rows.take('measurement', time, 0.0)
            rows.take('command', time + 1_000_000, 0.0)
        found = rows.end()
        away = [
            abs(short(row.values['reference'] - 3.0 * (row.time - 0.005) - 0.5, TURN))
            for row in found[5:-5]
        ]
        assert (max(away) < 1e-6) == (period > 0.0), max(away)


def test_columns_of_an_angle_go_on_where_nothing_was_measured() -> None:
    measured = COLUMNS['measurement'].copy()
    measured[200:220] = np.nan
    turned = unwrapped(COLUMNS | {'measurement': measured}, TURN)
    gap = np.isnan(measured)
    np.testing.assert_allclose(turned['measurement'][~gap], TURNING[~gap], atol=1e-9)
    np.testing.assert_allclose(turned['reference'], REFERENCE, atol=1e-9)
    blind = COLUMNS | {'measurement': np.full(len(T), np.nan)}
    assert unwrapped(blind, TURN)['reference'] is blind['reference']
