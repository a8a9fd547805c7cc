"""What a controller can know of a wrong setup: said when it is so, and not when it is not."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.nodes.doubts import Doubts
from nadrc_ros.ros.diagnostics import AGAIN, OK, Remarks, WARN
from nadrc_ros.ros.topics import Input, LATEST
import pytest
from rclpy.logging import get_logger

RATE = 100.0
GIVEN = ('b0', 'command_min', 'command_max')
GOOD: dict[str, Any] = {
    'plant_order': 1,
    'inner_bandwidth': 30.0,
    'outer_bandwidth': 30.0,
    'command_min': -10.0,
    'command_max': 10.0,
}


class Loop:
    """A controller on an integrator with a load, looked at once per second."""

    def __init__(
        self, given: tuple[str, ...] = GIVEN, deviation: float = 0.0, **settings: Any
    ) -> None:
        self.random, self.deviation = Random(1), deviation
        self.controller = Controller(ControllerSettings(**{**GOOD, **settings}))
        self.remarks = Remarks(get_logger('loop'))
        self.doubts = Doubts(self.controller, RATE, given, self.remarks)
        derivatives = self.controller.settings.received_derivatives
        names = ('/reference', '/reference/rate', '/reference/acceleration')[: 1 + derivatives]
        self.references = [
            Input(topic=n, qos=LATEST, silence=None, regular=False, sole=True) for n in names
        ]
        self.y = 0.0

    def run(
        self,
        seconds: int,
        reference: Callable[[float], float] | None = None,
        *,
        gain: float = 1.0,
        leak: float = 0.0,
        every: int = 1,
    ) -> str:
        """Let time pass with a sample in each so many periods, and return the remarks."""
        for k in range(round(seconds * RATE)):
            r = None if reference is None else [reference(k / RATE)]
            sampled = k % every == 0
            seen = self.y + self.random.gauss(0.0, self.deviation)
            y, dt = (seen, every / RATE) if sampled else (float('nan'), 0.0)
            u = self.controller.tick(y, dt, elapsed=1.0 / RATE, reference=r)
            self.y += (gain * u - leak * self.y - 3.0) / RATE
            if k % RATE == 0:
                self.doubts.look(every / RATE, self.references)
        return self.remarks.added_to(OK, '')[1]


def test_a_loop_that_is_well_gets_no_remark() -> None:
    assert Loop().run(20, lambda t: float(t > 5)) == ''


@pytest.mark.parametrize('leak', [0.0, 0.5])
def test_a_wrong_sign_of_b0_is_suspected_when_the_error_grows_at_a_limit(leak: float) -> None:
    said = Loop().run(20, lambda t: 1.0, gain=-1.0, leak=leak)
    assert 'the error grew' in said and 'wrong sign of b0' in said


def test_noise_hides_no_wrong_sign_and_is_no_growth() -> None:
    """The loop that is well rests at its limit, off its reference by what the sensor scatters."""
    for gain, suspected in ((-1.0, True), (1.0, False)):
        loop = Loop(deviation=0.05, command_max=3.0, inner_bandwidth=5.0, outer_bandwidth=5.0)
        for _ in range(40):
            said = loop.run(1, lambda t: 0.3, gain=gain)
            assert 'error grew' not in said or suspected
        assert loop.controller.limited_for > 10.0
        assert ('error grew' in said) == suspected


def test_at_its_safe_limit_a_loop_is_not_suspected() -> None:
    """A load that pulls is too much for who can only pull, as the sun is for a heater."""
    loop = Loop(command_max=0.0, safe_command=0.0)
    loop.y = 0.04
    assert loop.run(20, lambda t: 0.0) == ''
    assert loop.y < -10.0 and loop.controller.command == 0.0


def test_a_saturated_loop_whose_error_shrinks_is_not_suspected() -> None:
    assert Loop().run(20, lambda t: 1000.0) == ''


def test_a_reference_that_was_forgotten_is_told_and_what_is_held() -> None:
    loop = Loop(good_samples=1)
    loop.y = 1.25
    assert loop.run(3) == ''
    assert loop.run(3) == '; no reference yet: holding 1.25, as none comes on /reference'
    assert loop.run(2, lambda t: 1.0) == ''


def test_a_reference_that_is_refused_came_and_only_that_is_told() -> None:
    said = Loop(reference_max=10.0).run(10, lambda t: 50.0)
    assert said == '; the reference 50 is not taken: it is outside -1e+15 .. 10'


def test_a_measurement_outside_its_range_is_told_until_one_is_taken() -> None:
    loop = Loop(measurement_min=-6.0, measurement_max=-5.0)
    loop.y = 0.1
    told = 'the measurement 0.1 is not taken: it is outside -6 .. -5'
    assert told in loop.run(1, gain=0.0, leak=-3.0 / 0.1)
    loop.y = -5.5
    assert 'not taken' not in loop.run(1, gain=0.0, leak=3.0 / 5.5)
    refused = loop.controller
    refused.tick(float('nan'), 0.01)
    assert refused.refused_measurement is not None
    refused.tick(float('nan'), 0.0, elapsed=0.01)  # none came
    assert refused.refused_measurement is not None
    refused.tick(-5.5, 0.02)
    assert refused.refused_measurement is None


def test_in_a_slow_loop_five_periods_pass_before_something_is_missing() -> None:
    settings = GOOD | {'inner_bandwidth': 0.01, 'outer_bandwidth': 0.01, 'max_dt': 300.0}
    controller = Controller(
        ControllerSettings(**settings | {'measurement_timeout': 300.0}), checked=True
    )
    remarks = Remarks(get_logger('slow'))
    doubts = Doubts(controller, 1.0 / 30.0, GIVEN, remarks)
    topics = ('/reference', '/reference/rate')
    references = [
        Input(topic=name, qos=LATEST, silence=None, regular=False, sole=True) for name in topics
    ]
    told = []
    for second in range(300):
        if second % 30 == 0:
            controller.tick(0.0, 30.0)
        doubts.look(30.0, references)
        told.append('no reference yet' in remarks.added_to(OK, '')[1])
    assert 100 < told.index(True) < 200


def test_in_a_slow_loop_too_a_moving_reference_is_seen(capfd: pytest.CaptureFixture[str]) -> None:
    slow = Loop(max_dt=300.0, measurement_timeout=300.0, reference_derivatives='topics')
    slow.doubts = Doubts(slow.controller, 1.0 / 30.0, GIVEN, slow.remarks)
    for second in range(300):
        if second % 30 == 0:
            slow.controller.tick(0.0, 30.0, reference=[float(second)])
        slow.doubts.look(30.0, slow.references)
    assert 'followed late' in capfd.readouterr().err


@pytest.mark.parametrize(
    ('settings', 'said'),
    [
        ({'inner_bandwidth': 400.0}, 'inner_bandwidth / rate = 4, above 0.3'),
        ({'outer_bandwidth': 50.0}, 'outer_bandwidth / rate = 0.5, above 0.3'),
        ({'outer_bandwidth': 50.0, 'structure': 'conventional'}, ''),
    ],
)
def test_observers_that_are_too_fast_for_the_rate_are_told(
    settings: dict[str, Any], said: str
) -> None:
    loop = Loop(**settings)
    assert loop.run(1, lambda t: 0.0).removeprefix('; ') == said
    loop.controller.retune(ControllerSettings(**GOOD))
    assert loop.run(2, lambda t: 0.0) == ''


def test_a_plant_that_nobody_described_is_told() -> None:
    loop = Loop(given=(), command_min=-100.0)
    assert loop.run(1) == '; b0 = 1, command_min = -100: by default, and not of your plant'
    assert Loop(given=('b0',), command_min=-100.0).run(1) == ''
    loop.controller.retune(ControllerSettings(**GOOD, b0=2.0))
    assert loop.run(2) == ''


@pytest.mark.parametrize(
    ('settings', 'short'),
    [
        ({}, 'measurement_timeout = 0.25 and max_dt = 0.5'),
        ({'measurement_timeout': 0.0}, 'max_dt = 0.5'),
        ({'max_dt': 2.0}, 'measurement_timeout = 0.25'),
    ],
)
def test_a_sensor_too_slow_for_the_timeouts_is_told_with_what_would_do(
    settings: dict[str, Any], short: str
) -> None:
    said = Loop(**settings).run(8, lambda t: 0.0, every=100)
    assert f'measurements come every 1 s, too rarely for {short}: 3 s would do' in said
    assert Loop(measurement_timeout=3.0, max_dt=3.0).run(8, lambda t: 0.0, every=100) == ''


def test_a_moving_reference_without_derivatives_is_news(capfd: pytest.CaptureFixture[str]) -> None:
    for source, error_based, count in (
        ('topics', False, 0),
        ('topics', True, 0),
        ('topics', False, 1),
        ('auto', False, 0),
    ):
        loop = Loop(error_based=error_based, reference_derivatives=source)
        loop.references[1].count = count
        assert loop.run(8, lambda t: t) == ''
        told = 'nothing comes on /reference/rate: it is followed late' in capfd.readouterr().err
        assert told == (source == 'topics' and not error_based and not count)
    Loop(reference_derivatives='topics').run(8, lambda t: float(t > 3))
    assert 'followed late' not in capfd.readouterr().err


@pytest.mark.parametrize('how', ('tracking_acceleration', 'error_based'))
def test_derivatives_that_come_and_are_not_used_are_news(
    how: str, capfd: pytest.CaptureFixture[str]
) -> None:
    on: dict[str, Any] = {how: True if how == 'error_based' else 2.0}
    for settings, count in ((on, 0), ({}, 1), (on, 1)):
        loop = Loop(**settings)
        loop.references[1].count = count
        assert loop.run(8, lambda t: t) == ''
        told = f'/reference/rate is not used: {how} = ' in capfd.readouterr().err
        assert told == bool(settings and count)


def test_a_remark_is_logged_when_it_is_new_and_not_each_time_it_comes_and_goes(
    capfd: pytest.CaptureFixture[str],
) -> None:
    time = [0.0]
    remarks = Remarks(get_logger('remarks'), lambda: time[0])
    for _ in range(100):
        for text in ('it is 1', 'it is 2', ''):
            remarks.put('it', text)
    assert capfd.readouterr().err.count('it is') == 1
    time[0] = AGAIN + 1.0
    remarks.put('it', 'it is 3')
    assert capfd.readouterr().err.count('it is 3') == 1
    assert remarks.added_to(OK, 'well') == (WARN, 'well; it is 3')


def test_what_is_only_news_is_told_once(capfd: pytest.CaptureFixture[str]) -> None:
    time = [0.0]
    remarks = Remarks(get_logger('remarks'), lambda: time[0])
    for _ in range(10):
        time[0] += 2.0 * AGAIN
        remarks.put('it', 'it moves', OK)
        remarks.put('it', '')
    assert capfd.readouterr().err.count('it moves') == 1
