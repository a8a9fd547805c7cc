"""Logs of other people's tools as recorded runs: columns found, parts, angles, fewer rows."""

from __future__ import annotations

from math import nan, pi
from pathlib import Path

import attrs
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.records.angles import unwrapped
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recorded_run import Array, RecordedRun, window
from nadrc_ros.records.shaping import thinned, wrap_of
from nadrc_ros.records.source import Source
import numpy as np
import pytest

T: Array = 0.01 * np.arange(1000, dtype=np.float64)


def written(folder: Path, text: str) -> Path:
    path = folder / 'my log.csv'
    path.write_text(text, encoding='utf-8')
    return path


def run_of(**columns: Array) -> RecordedRun:
    usual = {'time': T, 'reference': 0.0 * T, 'measurement': 0.0 * T, 'command': 0.0 * T}
    return RecordedRun(
        path=Path('log'),
        rate=100.0,
        stop=float(usual['time'][-1]),
        columns=usual | columns,
        summary={},
    )


def test_columns_of_usual_names_are_found_and_told(tmp_path: Path) -> None:
    text = 'Zeit [ms];Setpoint;Speed (rpm);/motor/pwm;mode\n0;1;2,5;3;A\n10;1;2,75;4;B\n'
    run = read_run(written(tmp_path, text))
    assert run.rate == pytest.approx(100.0) and run.columns['time'] == pytest.approx([0.0, 0.01])
    assert run.columns['measurement'].tolist() == [2.5, 2.75]
    assert run.columns['command'].tolist() == [3.0, 4.0]
    assert run.columns['reference'].tolist() == [1.0, 1.0]
    assert (run.unit('measurement'), run.unit('command')) == ('rpm', '')
    assert run.told == (
        'semicolons between cells, decimal commas, UTF-8; time Zeit [ms] (guessed by its '
        'name, in ms, 0.01 s a row), command /motor/pwm (guessed by its name), reference '
        'Setpoint (guessed by '
        'its name), measurement Speed (rpm) (guessed by its name)'
    )


def test_seconds_are_assumed_aloud_where_nothing_tells_the_unit(tmp_path: Path) -> None:
    rows = 'rpm;pwm\n{};1;2\n{};2;3\n'
    path = written(tmp_path, 't;' + rows.format(0, 10))
    assumed = 't has no unit, and seconds are assumed: if not, --time-unit ms'
    told = read_run(path).told
    assert assumed in told and 'time t (guessed by its name, 10 s a row)' in told
    told = read_run(path, Source(time='t', time_unit='ms')).told
    assert 'assumed' not in told and 'time t (in ms, 0.01 s a row)' in told
    assert 'assumed' not in read_run(written(tmp_path, 't [s];' + rows.format(0, 1))).told
    clock = rows.format('10:00:00', '10:00:01')
    assert 'assumed' not in read_run(written(tmp_path, 't;' + clock)).told


def test_nanoseconds_taken_for_seconds_are_a_long_log(tmp_path: Path) -> None:
    rows = ''.join(f'{10_000_000 * k},{k},{-k}\n' for k in range(3000))
    run = read_run(written(tmp_path, 't,y,u\n' + rows))
    assert run.time == pytest.approx(1e7 * np.arange(3000), rel=1e-12)
    assert (run.command == -run.columns['measurement']).all() and run.rate == pytest.approx(1e-7)


def test_columns_that_are_named_are_taken(tmp_path: Path) -> None:
    path = written(tmp_path, 't,y,u,x1,true\n0,1,2,3,4\n2,1,2,5,6\n')
    signals = {'measurement': 'x1', 'command': '2', 'output': 'true'}
    run = read_run(path, Source(signals=signals, time='t', time_unit='ms'))
    assert run.rate == pytest.approx(500.0)
    assert [run.columns[name][1] for name in ('measurement', 'command', 'output')] == [
        5.0,
        1.0,
        6.0,
    ]
    assert np.isnan(run.columns['reference']).all() and 'no reference' in run.told


def test_signals_with_rows_of_their_own_are_paired_as_those_of_a_bag(tmp_path: Path) -> None:
    rows = ['0,1,,', '0.001,,10,', '0.01,2,,5', '0.011,,20,', '0.02,3,,', '0.03,4,,', '0.031,,40,']
    run = read_run(
        written(tmp_path, '__time/s,y,u,r\n' + '\n'.join(rows) + '\n').absolute(), Source(time='1')
    )
    assert run.columns['time'] == pytest.approx([0.0, 0.01, 0.02, 0.03])
    assert run.columns['measurement'].tolist() == [1.0, 2.0, 3.0, 4.0]
    assert run.columns['command'].tolist() == [10.0, 20.0, 20.0, 40.0]
    np.testing.assert_array_equal(run.columns['reference'], [nan, 5.0, 5.0, 5.0])


@pytest.mark.parametrize(
    ('text', 'source', 'said'),
    [
        ('a,b,c\n0,1,2\n1,2,3\n', Source(), 'which column is the time.*--time: a, b, c'),
        (
            't,b,c\n0,1,2\n1,2,3\n',
            Source(),
            'which column is the measurement.*--measurement: b, c',
        ),
        ('t,y,c\n0,1,2\n1,2,3\n', Source(), 'which column is the command.*--command: c'),
        ('t,y/state,x/state,u\n0,1,2,3\n1,2,3,4\n', Source(), 'measurement.*: y/state, x/state'),
        ('t,y,u\n0,1,2\n', Source(signals={'command': 'uu'}), "no column 'uu': did you mean u"),
        ('t,y,u\n0,1,2\n', Source(time='tt'), "no column 'tt': did you mean t"),
        ('t,y,u\n0,1,2\n', Source(time_unit='m'), "unit of time 'm': must be one of s, ms"),
        ('t,y,u\n0,1,2\n', Source(namespace='x'), 'a namespace is that of topics'),
        ('t,y,u\n0,1,2\n', Source(), 'too few measurements to tell their rate'),
        ('t,y,u\n0,1,\n1,2,\n', Source(), 'column u has no numbers in it'),
        ('t,y,u\n0,1,1\n0,2,1\n', Source(), 'line 3: t repeats that of line 2'),
        ('nothing of the kind', Source(), 'no table of at least two columns of numbers'),
    ],
)
def test_what_is_not_clear_is_asked_for(
    text: str, source: Source, said: str, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match=said) as caught:
        read_run(written(tmp_path, text), source)
    assert '\n' not in str(caught.value)


def test_a_window_keeps_its_times_and_needs_rows() -> None:
    part = window(run_of(), 2.0, 3.0)
    assert (part.columns['time'][0], part.columns['time'][-1]) == (2.0, 3.0)
    assert len(part.columns['command']) == 101
    assert len(window(run_of(), 9.0, None).columns['time']) == 100
    with pytest.raises(UserError, match=r'no row from 20 to 9\.99 s: the run has 0 to 9\.99 s'):
        window(run_of(), 20.0, None)


@pytest.mark.parametrize(
    ('period', 'low'), [(360.0, 0.0), (360.0, -180.0), (2 * pi, -pi), (4096.0, 0.0)]
)
def test_an_angle_that_wraps_is_known_and_can_be_unwrapped(period: float, low: float) -> None:
    noise = np.random.default_rng(1).normal(scale=1e-3 * period, size=len(T))
    turning: Array = period * (0.3 * np.sin(T) + 0.2 * T) + noise
    target: Array = period * 0.2 * T
    wrapped = run_of(
        measurement=(turning - low) % period + low, reference=(target - low) % period + low
    )
    assert wrap_of(wrapped.columns['measurement']) == period
    straight = unwrapped(wrapped.columns, period)
    shift = straight['measurement'] - turning
    np.testing.assert_allclose(shift, shift[0], atol=1e-9 * period)
    np.testing.assert_allclose(straight['reference'] - target, shift[0], atol=1e-9 * period)


@pytest.mark.parametrize(
    'values',
    [
        180.0 * np.sin(T),
        360.0 * (T > 5.0),
        np.where(T == 5.0, 359.0, 0.1 * np.sin(T)),
        np.random.default_rng(1).uniform(0.0, 360.0, len(T)),
        np.full(len(T), nan),
    ],
    ids=['turns back', 'a relay', 'a spike from noise', 'noise', 'nothing'],
)
def test_what_does_not_wrap_is_left_alone(values: Array) -> None:
    assert wrap_of(values) is None


def test_fewer_rows_keep_the_mean_command_and_the_motion() -> None:
    u = np.random.default_rng(1).normal(size=len(T))
    slow = run_of(measurement=np.sin(0.2 * T), command=u)
    thin, every = thinned(slow, 100)
    assert every == 10 and thin.rate == 10.0
    np.testing.assert_allclose(thin.columns['time'], T[::10])
    np.testing.assert_allclose(thin.columns['command'], u.reshape(-1, 10).mean(axis=1))
    np.testing.assert_array_equal(thin.columns['measurement'], np.sin(0.2 * T[::10]))
    assert thinned(slow, 1000) == (slow, 1)
    assert thinned(slow, 100, every=4)[1] == 4
    fast = attrs.evolve(slow, columns=slow.columns | {'measurement': np.sin(20.0 * T)})
    assert thinned(fast, 100)[1] <= 2
    lost = np.arange(len(T)) % 7 != 3
    part = attrs.evolve(slow, columns={name: c[lost] for name, c in slow.columns.items()})
    found = thinned(part, 100)[0].columns
    np.testing.assert_allclose(10.0 * found['time'], np.rint(10.0 * found['time']))
    assert found['command'][0] == pytest.approx(u[:10][lost[:10]].mean())
