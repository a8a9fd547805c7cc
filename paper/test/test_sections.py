"""The sections on figures, bounds, rates, differentiator and start: measured, drawn, checked."""

from __future__ import annotations

from copy import deepcopy
import json
from typing import Any

import attrs
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.report.style import render
from nadrc_ros.simulation.noise import Noise
import numpy as np
from paper import bounds, differentiator, rates, startup
from paper.drawing import thinned
from paper.loop import run
from paper.section import Result, Section
import pytest

SECTIONS = (bounds.SECTION, rates.SECTION, differentiator.SECTION, startup.SECTION)


@pytest.fixture(scope='module')
def results() -> dict[str, Result]:
    measured: dict[str, Result] = {}
    for section in SECTIONS:
        shares: list[float] = []
        measured[section.name] = section.measure(shares.append, 1)
        assert shares == sorted(shares) and shares[0] >= 0.0 and shares[-1] <= 1.0
    back: dict[str, Result] = json.loads(json.dumps(measured, allow_nan=False))
    assert back == measured
    return back


@pytest.mark.parametrize('section', SECTIONS, ids=lambda s: str(s.name))
def test_a_section_keeps_its_declared_tolerances(
    section: Section, results: dict[str, Result]
) -> None:
    assert section.check(results[section.name]) == []


@pytest.mark.parametrize(
    ('section', 'file_format'),
    [*((section, 'svg') for section in SECTIONS), (startup.SECTION, 'png')],
    ids=lambda given: getattr(given, 'name', given),
)
def test_a_picture_is_the_same_bytes_each_time(
    section: Section, file_format: str, results: dict[str, Result]
) -> None:
    first, second = (
        {stem: render(f, file_format) for stem, f in section.figures(result).items()}
        for result in (results[section.name], deepcopy(results[section.name]))
    )
    assert first and first == second
    assert not any(b'<dc:date>' in content for content in first.values())


def _worse_e3(result: Any) -> None:
    result['theorem_1'][0]['ramp'][2] *= 1.03


def _nested_over_corollary(result: Any) -> None:
    result['corollary_1'][3]['nested'] *= 1.05


def _printed_obeys_corollary(result: Any) -> None:
    result['corollary_1'][-1]['printed_bound'] = 1e3


def _itae_depends_on_rate(result: Any) -> None:
    result['rows'][2]['current_clean_itae'] *= 1.05


def _euler_is_cheap(result: Any) -> None:
    result['rows'][0]['euler_noisy_isu'] = result['rows'][0]['current_noisy_isu']


def _no_chatter(result: Any) -> None:
    result['rows'][1]['isu'] = result['rows'][0]['isu']


def _runaway(result: Any) -> None:
    result['rows'][0]['largest_r1'] = 2.0


def _no_peak(result: Any) -> None:
    result['starts']['zero']['off']['peak_command'] = 30.0


@pytest.mark.parametrize(
    ('section', 'spoil'),
    [
        (bounds.SECTION, _worse_e3),
        (bounds.SECTION, _nested_over_corollary),
        (bounds.SECTION, _printed_obeys_corollary),
        (rates.SECTION, _itae_depends_on_rate),
        (rates.SECTION, _euler_is_cheap),
        (differentiator.SECTION, _no_chatter),
        (differentiator.SECTION, _runaway),
        (startup.SECTION, _no_peak),
    ],
)
def test_a_number_out_of_tolerance_is_named(
    section: Section, spoil: Any, results: dict[str, Result]
) -> None:
    spoilt = deepcopy(results[section.name])
    spoil(spoilt)
    (sentence,) = section.check(spoilt)
    assert sentence.startswith(f'{section.name}: ')


def test_a_ramp_attains_the_sharp_bound_and_theorem_1_is_loose(results: dict[str, Result]) -> None:
    for row in results['bounds']['theorem_1']:
        assert row['ramp'][2] == pytest.approx(3.0 / row['bandwidth'], rel=1e-3)
        assert row['printed_bound'][2] / row['sharp_bound'][2] == pytest.approx(63.8015, rel=1e-5)


def test_the_printed_outer_observer_only_halves_what_is_left(results: dict[str, Result]) -> None:
    for row in results['bounds']['corollary_1']:
        assert row['printed'] == pytest.approx(row['e3'] / 2.0, rel=2e-2)


def test_the_euler_observer_diverges_where_theory_says() -> None:
    # Observer poles of Euler are at z = 1 - w h: on the unit circle at w h = 2, and the loop that
    # feeds the estimate back gives out before. The current observer has no such limit.
    assert 0.6 < rates.stability_limit(rates.euler) < 0.95
    assert rates.stability_limit(rates.current) > 2.0


def test_euler_and_current_observer_agree_at_a_high_rate() -> None:
    fast = attrs.evolve(rates.experiment(4000.0), noise=Noise(), duration=4.0)
    one, other = (run(fast, make()) for make in (rates.current, rates.euler))
    late = one.time > 1.0
    np.testing.assert_allclose(one.command[late], other.command[late], atol=0.1)


def test_the_literal_differentiator_chatters_and_as_printed_runs_away(
    results: dict[str, Result],
) -> None:
    rows = {(row['rate'], row['kind']): row for row in results['differentiator']['rows']}
    for rate in differentiator.RATES:
        turns = [rows[rate, kind]['switches_per_second'] for kind in ('fhan', 'sign')]
        assert turns[1] > 50.0 * turns[0]
        assert rows[rate, 'sign']['largest_r1'] < 1.1
        assert rows[rate, 'printed']['largest_r1'] > 10.0


def test_starting_from_the_measurement_does_away_with_peaking(results: dict[str, Result]) -> None:
    starts = results['startup']['starts']
    assert starts['zero']['off']['peak_command'] > 1000.0
    assert starts['zero']['on']['peak_command'] < 30.0
    assert starts['measured']['off']['peak_command'] < 2.0
    assert starts['measured']['on']['itae'] > starts['measured']['off']['itae']


def test_the_literal_law_is_the_law_behind_another_differentiator() -> None:
    settings = ControllerSettings(
        tracking_acceleration=2.0, reference_derivatives='differentiator'
    )
    literal = differentiator.Literal(settings, as_printed=False)
    literal([1.0, 0.0, 0.0], 0.0, 0.0, 0.01)
    literal([1.0, 0.0, 0.0], 0.0, 0.0, 0.01)
    assert literal.profile == pytest.approx([0.0002, 0.04, 0.0])


def test_thinning_keeps_peaks_and_smooth_curves() -> None:
    time = np.arange(10000) / 1000.0
    spike = np.where(time == 5.0, 7.0, 0.0)
    thin = thinned({'time': time, 'smooth': time**2, 'spike': spike}, points=100)
    assert len(thin['time']) == len(thin['spike']) <= 100
    assert max(thin['spike']) == 7.0
    np.testing.assert_allclose(np.square(thin['time']), thin['smooth'], rtol=1e-3)
