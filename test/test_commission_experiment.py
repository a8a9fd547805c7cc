"""Experiments of commissioning stay inside their bounds, whatever a machine does."""

from __future__ import annotations

from math import inf, isfinite, nan
from typing import Any

import attrs
from hypothesis import given, settings
from hypothesis import strategies as st
from nadrc_ros.adrc.commission.experiment import Experiment, Outcome
from nadrc_ros.adrc.commission.guard import Guard
from nadrc_ros.adrc.commission.settings import ExperimentSettings, KINDS, WITH_CONTROLLER
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.settings import ControllerSettings
import pytest

BOUNDS: dict[str, Any] = {'max_command': 2.0, 'travel': 1.0, 'speed': 3.0, 'amplitude': 0.5}
LONG: dict[str, Any] = {'silence': 1.0, 'predicted': (0.0,) * 100, 'band': (0.1,) * 100}
BASE = ExperimentSettings(command_min=-10.0, command_max=10.0, noise=1e-3, **LONG, **BOUNDS)
CONTROLLER = ControllerSettings(plant_order=2, b0=1.0)
H = BASE.period


def make(kind: str, **changes: Any) -> Experiment:
    controller = CONTROLLER if kind in WITH_CONTROLLER else None
    return Experiment(attrs.evolve(BASE, kind=kind, **changes), controller)


SAMPLES = st.one_of(
    st.floats(-1.0, 1.0),
    st.sampled_from([nan, inf, -inf, 0.0, 1e-308, 1e308, -1e308]),
    st.floats(),
)
TIMES = st.one_of(st.just(H), st.sampled_from([0.0, -1.0, nan, inf, 1e300]), st.floats(1e-3, 0.1))


@given(
    kind=st.sampled_from(KINDS),
    center=st.floats(-10.0, 10.0),
    rate_limit=st.sampled_from([0.0, 5.0]),
    sign=st.sampled_from([-1, 0, 1]),
    stream=st.lists(st.tuples(SAMPLES, TIMES, TIMES), min_size=1, max_size=60),
    good=st.integers(0, 60),
)
@settings(max_examples=300, deadline=None)
def test_p23_no_stream_leads_to_a_command_out_of_bounds(
    kind: str,
    center: float,
    rate_limit: float,
    sign: int,
    stream: list[tuple[float, float, float]],
    good: int,
) -> None:
    made = make(
        kind,
        center=center,
        command_rate_limit=rate_limit,
        sign=sign,
        reference_step=0.5,
        longest=2.0,
    )
    low, high = max(-10.0, center - 2.0), min(10.0, center + 2.0)
    for sample in [(0.0, H, H)] * good + stream:
        assert low <= made.tick(*sample) <= high
        assert isfinite(made.command) and isfinite(made.excitation)


@pytest.mark.parametrize('kind', KINDS)
def test_p23_a_silent_sensor_ends_it_within_the_timeout(kind: str) -> None:
    made = make(kind)
    for _ in range(30):
        made.tick(0.0, H, H)
    assert made.over is None
    silent = 0
    while made.over is None:
        made.tick(nan, 0.0, H)
        silent += 1
    assert silent in (25, 26)  # 0.25 s, by rounding
    assert made.outcome is Outcome.LOST
    assert made.command == BASE.center


@pytest.mark.parametrize('name', ['max_command', 'travel', 'speed'])
def test_bounds_have_no_default(name: str) -> None:
    given = {key: value for key, value in BOUNDS.items() if key != name}
    with pytest.raises(SettingError, match=name):
        ExperimentSettings(**given)


def test_one_odd_sample_is_passed_over_and_two_are_not() -> None:
    made = make('doublet')
    for _ in range(30):
        made.tick(0.0, H, H)
    made.tick(1e6, H, H)
    for _ in range(3):
        made.tick(0.0, H, H)
    assert made.over is None and made.stage == 'doublet'
    for _ in range(2):
        made.tick(1e6, H, H)
    assert made.outcome is Outcome.BOUND


def test_p23_what_runs_through_its_travel_in_some_pulses_is_no_rest() -> None:
    """However fast it may be: the noise of the slope is small against the travel, too."""
    wide = attrs.evolve(BASE, speed=10.0)
    narrow = attrs.evolve(wide, travel=0.05)
    for bounds in (wide, narrow):
        assert Guard(bounds).still * bounds.segment < 0.1 * bounds.travel
    assert Guard(narrow).window > Guard(wide).window


def test_p23_a_brake_of_unknown_sign_ends_when_the_motion_grows() -> None:
    made = make('staircase', noise=1e-5)
    y = v = at = 0.0
    while made.over is None:
        made.tick(y, H, H)
        v += H * (3.0 * v + 0.01)  # by itself, whatever is sent
        y += H * v
        at = y if made.outcome is None else at  # where the brake begins
    assert made.outcome is Outcome.BOUND and at < y < 0.5 * BOUNDS['travel']


def test_from_outside_it_ends_at_once() -> None:
    made = make('doublet')
    for _ in range(30):
        made.tick(0.0, H, H)
    assert made.command != BASE.center
    made.end('the operator let go')
    assert (made.over, made.outcome) == ('the operator let go', Outcome.STOPPED)
    assert made.tick(0.0, H, H) == BASE.center
