"""The parts of a report: thinning, spectrum, timelines, truth, moments, names, words."""

from __future__ import annotations

from math import nan
from pathlib import Path

from hypothesis import given, strategies
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.cli import demo
from nadrc_ros.records.history import (
    append_event,
    append_parameters,
    Change,
    Event,
    EVENTS,
    History,
    PARAMETERS,
    read_history,
)
from nadrc_ros.records.read_run import read_runs
from nadrc_ros.records.recorded_run import Array, referred, sampled
from nadrc_ros.report import tables
from nadrc_ros.report.curves import command_spectrum, kept
from nadrc_ros.report.marks import numbered, text_of
from nadrc_ros.scenario import loads
import numpy as np
import pytest
from report_helpers import describe, record

NUMBERS = strategies.floats(-1e6, 1e6) | strategies.just(float('nan'))


@given(strategies.lists(NUMBERS, min_size=1, max_size=300), strategies.integers(5, 100))
def test_thinning_keeps_ends_peaks_gaps_and_order(values: list[float], points: int) -> None:
    column = np.array(values)
    index = kept(column, points)
    assert len(index) <= max(points, 5)
    assert (np.diff(index) > 0).all()
    assert index[0] == 0 and index[-1] == len(values) - 1
    thin = column[index]
    assert np.isnan(thin).any() == np.isnan(column).any()
    if not np.isnan(column).all():
        assert np.nanmin(thin) == np.nanmin(column) and np.nanmax(thin) == np.nanmax(column)
    if len(values) <= points:
        assert len(index) == len(values)


def noisy_sine(count: int) -> tuple[Array, Array]:
    time = np.arange(count) / 200.0
    noise = np.random.default_rng(3).normal(0.0, 0.3, count)
    return time, np.sin(2.0 * np.pi * 25.0 * time) + noise + 7.0


def test_the_spectrum_has_the_power_of_the_command_at_its_frequency() -> None:
    time, command = noisy_sine(4000)
    found = command_spectrum(time, command, 200.0)
    assert found is not None
    frequency, density = found
    assert frequency[density.argmax()] == pytest.approx(25.0, abs=0.3)
    assert density.sum() * frequency[0] == pytest.approx(0.5 + 0.09, rel=0.05)  # Parseval
    assert density[frequency > 50.0].mean() == pytest.approx(0.09 / 100.0, rel=0.1)


def test_a_lost_sample_of_the_command_is_held_and_shifts_nothing() -> None:
    time, command = noisy_sine(4000)
    there = np.random.default_rng(4).random(4000) > 0.02
    command[5:9] = np.nan
    found = command_spectrum(time[there], command[there], 200.0)
    assert found is not None
    assert found[0][found[1].argmax()] == pytest.approx(25.0, abs=0.3)
    assert command_spectrum(time[:60], command[:60], 200.0) is None
    assert command_spectrum(time, np.full(4000, np.nan), 200.0) is None


def test_what_holds_is_the_last_step() -> None:
    time = np.array([-1.0, 0.0, 0.99, 1.0, 5.0])
    assert sampled([(0.0, 2.0), (1.0, 3.0)], time).tolist() == [2.0, 2.0, 2.0, 3.0, 3.0]


def test_the_truth_is_that_for_b0_of_the_controller_at_its_time(tmp_path: Path) -> None:
    """L = y^(n) - b0 u: with the plant's b0 = 1 the record differs by (1 - b0) u."""
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    append_parameters(run, 1.0, '/mine/controller', {'b0': 4.0})
    (subject,) = read_runs([run]).values()
    assert subject.referred
    recorded, u = subject.columns['total_disturbance'], subject.command
    b0 = np.where(subject.time < 1.0, 2.0, 4.0)
    np.testing.assert_allclose(subject.total_disturbance, recorded + (1.0 - b0) * u, atol=1e-12)
    assert referred([0.0], [2.0], [1.0], [(0.0, 3.0)], [(0.0, 1.0)]).tolist() == [5.0]


def test_the_picture_of_a_demo_takes_the_recorded_time_of_a_retune(tmp_path: Path) -> None:
    scenario = loads(
        'plant: paper\nreference: cosine\n'
        'controllers: {mine: {b0: 2}}\nretune: [{time: 0.9, b0: 4}]\n'
    )
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    append_parameters(run, 1.0, '/mine/controller', {'b0': 4.0})
    (subject,) = read_runs([run]).values()
    drawn = demo._recorded(scenario, 'mine', run).total_disturbance
    np.testing.assert_array_equal(drawn, subject.total_disturbance)
    (run / PARAMETERS).unlink()  # as in a short run in lockstep
    unknown = demo._recorded(scenario, 'mine', run).total_disturbance
    recorded = subject.columns['total_disturbance']
    np.testing.assert_allclose(unknown, recorded - subject.command, atol=1e-12)


def told(run: Path) -> list[str]:
    found, more = tables.happened(read_runs([run]), [])
    assert found and not more
    return [' '.join(cell.text for cell in row) for row in found.rows]


def test_what_happened_is_listed_in_order(tmp_path: Path) -> None:
    run = record(tmp_path)
    assert tables.happened(read_runs([run]), []) == (None, 0)
    append_event(run, Event(None, '/mine/controller', 'enable', 'enabled'))
    append_event(run, Event(2.0, '/mine/recorder', 'gap', 'no <measurement>'))
    append_event(run, Event(1.5, '/mine/controller', 'mode', 'holding'))
    assert told(run) == [
        ' 1.500 2.490 controller holding',
        ' 2.000  recorder no <measurement>',  # of another signal: the measurement went on
    ]  # enabled was before the run
    append_event(run, Event(None, '/mine/recorder', 'late', '7 commands were sent before'))
    assert told(run)[0] == ' 0.000  recorder 7 commands were sent before'
    append_event(run, Event(2.5, '/mine/plant', 'fault', 'measurement silent'))
    append_event(run, Event(3.0, '/mine/plant', 'fault', 'none'))
    append_event(run, Event(None, '/mine/controller', 'mode', 'in control'))
    append_event(run, Event(3.5, '/mine/controller', 'mode', 'in control'))
    assert ' 2.500 0.500 plant measurement silent' in told(run)
    (run / EVENTS).write_text('{"time": 1.0, "node": "/mine"}\n')
    with pytest.raises(UserError, match=r'events\.jsonl, line 1'):
        read_history(run)


def test_of_modes_before_the_run_the_last_one_holds(tmp_path: Path) -> None:
    run = record(tmp_path)
    for time, mode in ((None, 'in control'), (None, 'holding'), (1.0, 'in control')):
        append_event(run, Event(time, '/mine/controller', 'mode', mode))
    assert told(run) == [
        ' 0.000 1.000 controller holding',
        ' 1.000 2.990 controller in control',
    ]


def test_the_code_of_a_plant_that_a_record_names_is_not_run(tmp_path: Path) -> None:
    plant = tmp_path / 'plant.py'
    plant.write_text(f'open({str(tmp_path / "ran")!r}, "w")')
    run = record(tmp_path / 'runs')
    describe(run, '/mine')
    append_parameters(run, None, '/mine/plant', {'plant': str(plant)})
    (subject,) = read_runs([run]).values()
    assert not subject.referred and not (tmp_path / 'ran').exists()
    np.testing.assert_array_equal(subject.total_disturbance, subject.columns['total_disturbance'])


def test_settings_that_this_version_does_not_know_are_left_out(tmp_path: Path) -> None:
    run = record(tmp_path)
    describe(run, '/mine')
    append_parameters(run, 1.0, '/mine/controller', {'structure': 'of the future'})
    append_parameters(run, 2.0, '/mine/controller', {'structure': 'cascade', 'new': 1})
    history = read_history(run)
    steps = history.controller_settings()
    assert [(time, each.structure) for time, each in steps] == [(0.0, 'nested'), (2.0, 'cascade')]
    assert history.plant_gain() == [(0.0, 1.0)]
    assert History().controller_settings() == []


def test_a_parameter_that_is_no_number_and_stays_so_has_not_changed(tmp_path: Path) -> None:
    for time in (None, 1.0, 2.0):
        append_parameters(tmp_path, time, '/mine/driver', {'limit': nan, 'limits': [nan, 1.0]})
    append_parameters(tmp_path, 3.0, '/mine/driver', {'limit': 1.0})
    assert [change.name for change in read_history(tmp_path).changes] == ['limit']


def test_changes_side_by_side_are_one_moment() -> None:
    def change(time: float, value: float, node: str = 'controller') -> Change:
        return Change(time, f'/ns/{node}', 'b0', 1.0, value)

    moments = numbered(
        {
            'a': [change(1.0, 2.0), change(3.0, 4.0)],
            'b': [change(1.05, 2.0), change(1.06, 2.0, 'plant')],
        }
    )
    assert [(m.number, m.time) for m in moments] == [(1, 1.0), (2, 3.0)]
    assert [runs for _, runs in moments[0].changes] == [['a', 'b'], ['b']]
    assert moments[0].mark() == (1.0, 'b0 2')


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (40.0, '40'),
        (0.1 + 0.2, '0.30000000000000004'),
        (2**63 - 1, '9223372036854775807'),
        (True, 'true'),
        ([1.0, 0.5], '[1, 0.5]'),
        ('a', 'a'),
    ],
)
def test_values_are_shown_to_the_bit(value: object, text: str) -> None:
    assert text_of(value) == text


def test_runs_are_named_by_what_tells_them_apart(tmp_path: Path) -> None:
    a, b, c = (record(tmp_path / name, count=3) for name in 'abc')
    b, c = b.rename(b.with_name(a.name)), c.rename(c.with_name(a.name))
    assert list(read_runs([a, a])) == [a.name]
    assert list(read_runs([a, b])) == [str(a), str(b)]
    describe(a, '/one')
    describe(b, '/two')
    describe(c, '/two')
    assert list(read_runs([a, b])) == ['one', 'two']
    moved = c.rename(c.parent / 'other')
    assert list(read_runs([b, moved])) == [b.name, 'other']


def test_latency_and_period_come_from_stamps(tmp_path: Path) -> None:
    (subject,) = read_runs([record(tmp_path, count=50, command_stamp=2.3)]).values()
    stamps = subject.columns['measurement_stamp']
    assert np.array_equal(subject.latency, 2.3 - stamps[stamps <= 2.3])
    assert subject.periods == pytest.approx(np.full(49, 0.01), abs=2e-4)


def test_of_a_part_of_a_run_the_figures_count_from_its_begin(tmp_path: Path) -> None:
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    for at, b0 in ((1.0, 4.0), (2.5, 5.0), (3.5, 6.0)):
        append_parameters(run, at, '/mine/controller', {'b0': b0})
    (subject,) = read_runs([run], begin=2.0, end=3.0).values()
    time, error = subject.time, np.abs(subject.error)
    assert (time[0], time[-1]) == (2.0, 3.0)
    late = np.sum((time - 2.0) * error) * 0.01
    assert subject.metrics.itae == pytest.approx(late, rel=0.02)
    assert [change.after for change in subject.changes] == [5.0]
    assert subject.gains[1][1] == (1.0, 4.0)  # what held there is known all the same
    with pytest.raises(UserError, match='no row from 9 to'):
        read_runs([run], begin=9.0)


@pytest.mark.parametrize(
    ('values', 'texts', 'best'),
    [
        ([21.507, 2.031, 0.3813], '21.51 2.03 0.38', [2]),
        ([21.5, 0.03812, 0.03814], '21.50000 0.03812 0.03814', [1]),
        ([166.1, 178.3, 178.3000001], '166 178 178', [0]),
        ([178.3, 178.3000001, 200.0], '178 178 200', [0, 1]),
        ([178.3, 178.3000001], '178.3 178.3', []),
        ([1e9, 0.381, 0.382, nan], '1.00e9 0.3810 0.3820 –', [1]),
        ([7.443e-5], '7.443e-5', []),
        ([1e300, 3e300], '1.00e300 3.00e300', [0]),
        ([1.0, 1e-17], '1.00 1.000e-17', [1]),
        ([0.0, 0.0], '0 0', []),
    ],
)
def test_figures_differ_in_what_is_shown_or_share_the_win(
    values: list[float], texts: str, best: list[int]
) -> None:
    found = tables.shown_together('itae', values, plain=True)
    assert found == texts.split()
    assert [k for k, wins in enumerate(tables.winners(found, values)) if wins] == best


def test_shares_of_the_time_that_differ_read_differently() -> None:
    shown = tables.shown_together('saturated_fraction', [0.0, 0.0, 0.0003])
    assert shown == ['0.000 %', '0.000 %', '0.030 %']
