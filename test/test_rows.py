"""Rows of samples that come as they like: each belongs to an instant, by when its samples left."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from itertools import pairwise
from math import cos, isnan, nan
import random

from hypothesis import given
from hypothesis import strategies as st
from nadrc_ros.adrc.settings import HIGHEST
from nadrc_ros.records import source
from nadrc_ros.records.figures import Figures
from nadrc_ros.records.recording import RunSettings
from nadrc_ros.records.rows import Row, Rows
from nadrc_ros.simulation.metrics import Metrics
import numpy as np
import pytest

MS = 1_000_000
NAMES = ('reference', 'measurement', 'command', 'output', 'level_1')
START = 1_000 * MS
Sample = tuple[str, int, float]


def loop(
    times: Iterable[float],
    period: float = 5.0,
    value: Callable[[float], float] = lambda t: t,
    truth: bool = True,
) -> list[Sample]:
    """Return what a loop sends at each of these times [ms], each signal ``value`` of its time."""
    samples: list[Sample] = []
    for t in times:
        sent = {'measurement': 0.0, 'reference': -0.6 * period, 'command': 0.2 * period}
        sent |= {'level_1': 0.3 * period} | ({'output': 0.01 * period} if truth else {})
        for name, later in sent.items():
            of = t + later if name == 'reference' else t
            samples.append((name, START + round((t + later) * MS), value(of)))
    return samples


def in_order(samples: Iterable[Sample]) -> list[Sample]:
    return sorted(samples, key=lambda sample: sample[1])


def rows_of(samples: Iterable[Sample], names: Sequence[str] = NAMES, every: int = 7) -> list[Row]:
    """Return the rows of samples that are closed now and then, and at the end."""
    rows, found = Rows(list(names)), []
    heard = [sample for sample in samples if sample[0] in names]
    for k, (name, time, value) in enumerate(heard):
        rows.take(name, time, value, time / 1e9)
        if k % every == 0:
            found += rows.close(rows.newest - 200 * MS)
    found += rows.end()
    assert rows.late == 0
    return found


def test_a_row_is_an_instant_with_the_command_that_acted_until_the_next() -> None:
    rows = rows_of(loop(range(0, 500, 5)))
    assert [row.time for row in rows] == pytest.approx([0.005 * k for k in range(100)])
    for k, row in enumerate(rows):
        assert row.values['measurement'] == row.values['output'] == 5.0 * k
        assert row.values['command'] == row.values['level_1'] == 5.0 * k
        assert row.stamps['command'] == pytest.approx(START / 1e9 + 0.005 * k + 0.001)
        if 2 < k < 99:  # between the samples of a reference that moves
            assert row.values['reference'] == pytest.approx(5.0 * k, abs=1e-6)


@given(st.integers(0, 2**32), st.sampled_from([1.0, 5.0, 50.0, 1e6]))
def test_the_order_of_arrival_within_the_wait_changes_nothing(seed: int, period: float) -> None:
    rng = random.Random(seed)
    times = [k * period for k in range(60) if rng.random() < 0.9]
    samples = loop(times, period)
    late = sorted(samples, key=lambda sample: sample[1] + rng.uniform(0.0, 15.0 * MS))
    found, expected = rows_of(late, every=rng.randint(1, 20)), rows_of(in_order(samples))
    assert [row.time for row in found] == [row.time for row in expected]
    for one, two in zip(found, expected):
        assert one.stamps == two.stamps
        between = one.values.pop('reference') - two.values.pop('reference')
        assert one.values == two.values
        # how often it comes is learnt on the way, and when depends on the order
        assert abs(between) < period


def test_a_silent_sensor_leaves_rows_of_the_truth_and_nothing_of_later() -> None:
    samples = loop(range(0, 2000, 5))
    silent = [s for s in samples if s[0] != 'measurement' or not 500 <= s[1] / MS - 1000 < 1500]
    rows = rows_of(silent)
    assert len(rows) == 400
    for k, row in enumerate(rows):
        assert row.time == pytest.approx(0.005 * k, abs=1e-4)
        assert isnan(row.values['measurement']) == (500 <= 5 * k < 1500)
        assert row.values['output'] == row.values['command'] == 5.0 * k


def test_silence_of_all_is_a_gap_that_no_row_reaches_into() -> None:
    times = [*range(0, 500, 5), *range(2500, 3000, 5)]
    samples = loop(times, truth=False)
    samples += [(name, START + 1500 * MS, -1.0) for name in ('command', 'reference')]
    rows = rows_of(in_order(samples), NAMES[:3])
    assert [round(1e3 * row.time) for row in rows] == times
    assert rows[99].values == {'reference': 495.0 - 3.0, 'measurement': 495.0, 'command': 495.0}
    assert rows[100].values['measurement'] == 2500.0


def test_a_row_before_silence_is_made_without_a_next_one() -> None:
    rows = Rows(NAMES)
    for name, time, value in loop(range(0, 500, 5)):
        rows.take(name, time, value)
    assert len(rows.close(START + 600 * MS)) == 100


def test_measurements_slower_than_the_truth_are_the_instants() -> None:
    samples = loop(range(0, 2000, 20), 20.0)
    samples = [s for s in samples if s[0] != 'output']
    samples += [('output', START + t * MS, float(t)) for t in range(2000)]
    rows = rows_of(in_order(samples))
    times = [round(1e3 * row.time) for row in rows]
    assert times == [*range(0, 2000, 20), *range(1996, 2000)]
    assert all(row.values['output'] == row.values['measurement'] for row in rows[:99])


@pytest.mark.parametrize('late', [-0.3, 0.1, 3.0])
def test_an_output_that_comes_early_or_late_belongs_to_its_measurement(late: float) -> None:
    samples = [s for s in loop(range(0, 500, 5)) if s[0] != 'output']
    samples += [('output', START + round((t + late) * MS), float(t)) for t in range(0, 500, 5)]
    rows = rows_of(in_order(samples))
    assert [row.values['output'] for row in rows[2:]] == [5.0 * k for k in range(2, 100)]


def test_a_reference_that_is_set_by_hand_is_held() -> None:
    samples = [s for s in loop(range(0, 2000, 5)) if s[0] != 'reference']
    samples += [('reference', START + t * MS, t / 1e3) for t in (-300, 702, 1303)]
    rows = rows_of(in_order(samples))
    assert {row.values['reference'] for row in rows} == {-0.3, 0.702, 1.303}
    assert [row.values['reference'] for row in rows][140:142] == [-0.3, 0.702]


def test_a_step_of_a_reference_that_comes_all_the_time_stays_a_step() -> None:
    rows = rows_of(loop(range(0, 500, 5), value=lambda t: float(t > 253.0)))
    assert {row.values['reference'] for row in rows} == {0.0, 1.0}


def test_where_the_reference_missed_periods_it_lies_between() -> None:
    """As when its process stood still for 35 ms: the rows saw one that was so old."""
    samples = loop(range(0, 500, 5), value=lambda t: cos(1e-3 * t))
    kept = [s for s in samples if s[0] != 'reference' or not 200 <= s[1] / MS - 1000 < 235]
    error = [row.values['reference'] - cos(row.time) for row in rows_of(kept)]
    assert np.abs(error[3:-1]).max() < 1e-3  # 0.008 is what it moves in 35 ms


def test_time_begins_with_the_last_instant_before_the_first_command() -> None:
    samples = [s for s in loop(range(0, 500, 5)) if s[0] != 'command' or s[1] >= START + 250 * MS]
    rows = rows_of(samples)
    assert (rows[0].time, rows[0].values['measurement'], len(rows)) == (0.0, 250.0, 50)


def test_no_measurement_is_left_out_that_comes_twice_or_in_one_instant() -> None:
    rows = rows_of((n, t + d, v) for n, t, v in loop(range(0, 500, 5)) for d in (0, MS // 20))
    measured = [row.values['measurement'] for row in rows]
    assert measured[-190:] == [5.0 * k for k in range(5, 100) for _ in range(2)]
    assert all(one.time < two.time for one, two in pairwise(rows))


def test_what_comes_after_its_rows_were_made_is_counted() -> None:
    rows = Rows(NAMES[:3])
    for name, time, value in loop(range(0, 500, 5), truth=False):
        if name in NAMES[:3]:
            rows.take(name, time, value)
    rows.close(START + 400 * MS)
    rows.take('measurement', START + 300 * MS, 1.0)
    assert rows.late == 1


@pytest.mark.parametrize('at_once', [50, 10_000])
@pytest.mark.parametrize('truth', [1.0, 0.5, 5.0])
def test_columns_of_a_whole_log_are_the_rows_of_the_recorder(
    truth: float, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(source, '_SAMPLES_AT_ONCE', at_once)
    rng, sent = random.Random(2), loop(range(0, 1500, 5), value=lambda t: cos(0.01 * t))
    samples = [s for s in sent if rng.random() > 0.05 and s[0] != 'output']
    samples += [
        ('output', START + round(5 * truth * k * MS) + MS // 20, float(k))
        for k in range(round(300 / truth))
    ]
    samples = in_order((n, t + rng.randint(0, MS // 4), v) for n, t, v in samples)
    rows = rows_of(samples)
    of = {name: [s for s in samples if s[0] == name] for name in NAMES}
    columns, stop = source.rows_of(
        {name: np.array([1e-9 * (t - START) for _, t, _ in each]) for name, each in of.items()},
        {name: np.array([v for _, _, v in each]) for name, each in of.items()},
    )
    assert columns['time'] == pytest.approx(np.array([row.time for row in rows]), abs=1e-9)
    assert stop == pytest.approx(1e-9 * (samples[-1][1] - of['measurement'][0][1]))
    for name in NAMES:
        expected = np.array([row.values[name] for row in rows])
        np.testing.assert_allclose(columns[name], expected, rtol=1e-6, err_msg=name)


# ---- the end ----------------------------------------------------------------------------------


@pytest.mark.parametrize('duration', [None, 10_000])
def test_a_stream_that_ended_before_the_others_leaves_a_gap_up_to_the_end(
    duration: int | None,
) -> None:
    rows = Rows(NAMES[:3]) if duration is None else Rows(NAMES[:3], duration * MS)
    for name, time, value in loop(range(0, 15_000, 10), 10.0, truth=False):
        if name in NAMES[:3] and (name != 'measurement' or time < START + 5000 * MS):
            rows.take(name, time, value)
    made = [*rows.close(rows.newest - 300 * MS), *rows.end()]
    stop = 1e-3 * (duration or 14_992)  # the last command
    assert rows.stop == START + stop * 1e9
    (gap,) = rows.gaps
    assert (gap.signal, gap.time - START, gap.lost) == ('measurement', 4990 * MS, 0)
    assert gap.length == pytest.approx((stop - 4.99) * 1e9)
    found = Figures(RunSettings())
    for row in made:
        found.add(row.time, row.values)
    found.end(stop)
    assert (found.rows, found.stop) == (500, stop)
    assert found.gap_time == pytest.approx(stop - 5.0)
    assert found.periods == round(stop / 0.01)
    assert found.values().duration == pytest.approx(5.0)


@pytest.mark.parametrize(('kind', 'told'), [('moves', 1), ('constant', 0), ('seldom', 0)])
def test_a_reference_that_moved_on_unheard_leaves_a_gap(kind: str, told: int) -> None:
    rows = Rows(list(NAMES))
    for name, time, value in in_order(loop(range(0, 2000, 5))):
        at = round((time - START) / MS)
        if name == 'reference':
            if 1000 < at < 1120 or (kind == 'seldom' and at % 25 > 4):
                continue
            value = 1.0 if kind == 'constant' else value
        rows.take(name, time, value)
    made = rows.close(rows.newest)
    assert [gap.signal for gap in rows.gaps] == ['reference'] * told
    held = [row.values['reference'] for row in made if 1.005 < row.time < 1.115]
    assert len(set(held)) == 1  # nobody told another one


def test_what_is_lost_counts_up_to_the_end_of_the_duration() -> None:
    """A recorder without a processor looks only long after that."""
    lost = {400: 2, 1500: 500, 1700: 40}  # before 400 ms, from 990 to 1500 ms, to 1700 ms
    rows, count = Rows(NAMES[:3], 1000 * MS), 0
    for name, time, value in loop(range(0, 2000, 5), truth=False):
        at = round((time - START) / MS)
        if name == 'measurement' and 990 < at < 1500:
            continue
        if name in NAMES[:3]:
            rows.take(name, time, value, lost=lost.get(at, 0) if name == 'measurement' else 0)
        count += len(rows.close(rows.newest - 300 * MS)) if at % 50 == 0 and at > 1600 else 0
    assert rows.lost == {'reference': 0, 'measurement': 2 + 10, 'command': 0}
    count += len(rows.end())
    assert count == 199
    assert rows.lost['measurement'] == 12
    assert not rows.gaps


def test_before_the_first_command_nothing_is_lost() -> None:
    rows = Rows(NAMES[:3])
    for name, time, value in loop(range(0, 1000, 5), truth=False):
        if name in NAMES[:3] and (name != 'command' or time >= START + 500 * MS):
            rows.take(name, time, value, lost=int(name != 'reference'))
            rows.close(rows.newest - 100 * MS)
    rows.end()
    assert rows.lost == {'reference': 0, 'measurement': 99, 'command': 99}


# ---- figures of merit -------------------------------------------------------------------------


def figures_of(rows: Iterable[Row], rate: float = 0.0) -> Figures:
    found = Figures(RunSettings(rate=rate, settle_time=0.1))
    for row in rows:
        found.add(row.time, row.values)
    found.end()
    return found


@pytest.mark.parametrize('period', [2.5, 5.0, 1000.0, 1e6])
def test_the_figures_take_their_time_from_the_rows_whatever_the_rate(period: float) -> None:
    times = [period * k for k in range(200)]
    samples = loop(times, period, value=lambda t: 1.0, truth=False)
    zero = [(n, t, 0.0 if n == 'measurement' else v) for n, t, v in samples]
    found = figures_of(rows_of(zero, NAMES[:3]))
    seconds = 0.2 * period
    assert found.values().iae == pytest.approx(seconds)
    assert found.values().duration == pytest.approx(seconds)
    assert found.rate == pytest.approx(1e3 / period)
    assert (found.rows, found.periods, found.gap_time) == (200, 200, 0.0)


def test_a_gap_without_truth_is_in_no_figure_and_is_told() -> None:
    times = [*range(0, 1000, 5), *range(3000, 4000, 5)]
    row = {'reference': 1.0, 'measurement': 0.0, 'command': 1.0}
    found = figures_of([Row(t / 1e3, row) for t in times])
    assert found.values().iae == pytest.approx(2.0)
    assert found.gap_time == pytest.approx(2.0)
    assert (found.rows, found.periods) == (400, 800)


def test_missed_periods_are_in_the_figures() -> None:
    rng = random.Random(3)
    times = [5 * k for k in range(1000) if rng.random() > 0.3 or k in (0, 999)]
    row = {'reference': 1.0, 'measurement': 0.0, 'command': 1.0}
    found = figures_of([Row(t / 1e3, row) for t in times])
    assert found.values().iae == pytest.approx(5.0)
    assert found.periods == pytest.approx(1000, rel=0.01)
    assert found.rate == pytest.approx(200.0, rel=0.01)


@pytest.mark.parametrize('early', [-1e-4, 0.0, 1e-4])
def test_the_peak_counts_the_row_of_the_settle_time_though_it_comes_a_little_early(
    early: float,
) -> None:
    """Of a falling error the demo's peak was 3 % less than that of the simulation."""
    rows = [
        Row(0.01 * k - early, {'reference': 1.0 - 0.05 * k, 'measurement': 0.0, 'command': 0.0})
        for k in range(15)
    ]
    assert figures_of(rows).values().peak_error == pytest.approx(0.5)


def test_a_rate_makes_every_row_a_period_as_in_the_simulation() -> None:
    settings = RunSettings(rate=300.0, command_max=HIGHEST - 1.0)
    found, same = Figures(settings), Metrics(float('inf'))
    for k in range(100):
        found.add(
            k / 300.0, {'reference': 0.1 * k, 'measurement': nan, 'output': 1.0, 'command': k}
        )
        same.add(k / 300.0, 1.0 / 300.0, 0.1 * k - 1.0, k)
    assert found.values() == same.values()


def test_without_limits_nobody_knows_what_was_saturated() -> None:
    row = {'reference': 1.0, 'measurement': 0.0, 'command': 1.0}
    for settings, share in ((RunSettings(rate=1.0), None), (RunSettings(command_max=1.0), 1.0)):
        found = Figures(settings)
        for k in range(5):
            found.add(float(k), row)
        found.end()
        assert found.values().as_dict()['saturated_fraction'] == share
