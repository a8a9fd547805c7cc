"""A live change of any setting is bumpless, atomic and leaves the loop well."""

from __future__ import annotations

from math import copysign, isfinite, nan
from pickle import dumps, loads
import random
from typing import Any

import attrs
from law_helpers import Chain, NAMES, noise, varied_settings
from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.errors import SettingError
from nadrc_ros.adrc.fields import declared
from nadrc_ros.adrc.limiter import limit
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.state import raw_command
from nadrc_ros.adrc.status import Cause, Mode, Status
import pytest

H = 0.01
CASES = varied_settings()
FIELDS = {name: f for name, f in declared(ControllerSettings).items() if f.live}
# Changes that let the command stay where it is: limits only become wider.
VALUES: dict[str, tuple[Any, ...]] = {
    'b0': (0.5, 2.0, 40.0),
    'b0_table': ((0.0, 0.5, 1.0, 2.0), (-1.0, 40.0, 5.0, 1.0)),
    'structure': NAMES,
    'inner_bandwidth': (5.0, 39.0, 200.0),
    'outer_bandwidth': (5.0, 31.0, 200.0),
    'levels': (1, 2, 3, 6),
    'startup_time': (0.0, 0.3),
    'eso_delta': (1e-3, 1.0),
    'bandwidth_ratio': (0.1, 2.0),
    'extended_states': (1, 2, 3, 4, 5),
    'pole_ratios': ((0.5,), (2.0,)),
    'plant_poles': ((-5.0,), (0.3,), (-300.0,)),
    'disturbance_frequencies': ((0.0,), (30.0,), (33.0, 11.0, 2.0)),
    'observer_gain_factor': (0.5, 0.8),
    'controller_bandwidth': (1.0, 3.9, 20.0),
    'feedback': ('linear', 'fal'),
    'fal_gains': ((3.0,), (50.0,)),
    'fal_exponents': ((0.2,), (1.0,)),
    'fal_delta': (1e-4, 1.0),
    'feedback_level': ('inner', 'outer', '2', '6'),
    'tracking_acceleration': (0.0, 1.0, 100.0),
    'error_based': (False, True),
    'error_deadband': (1e-6, 1.0, 1e3),
    'command_min': (-21.0, -1e9),
    'command_max': (31.0, 1e9),
    'command_rate_limit': (0.0, 1e3, 1e12),
    'safe_command': (0.0, -1.0),
    'input_delay': (0.0, 0.004, 0.05, 3.0),
    'measurement_min': (-1e3, -1e15),
    'measurement_max': (1e3, 1e15),
    'reference_min': (-1e3, -1e15),
    'reference_max': (1e3, 1e15),
    'measurement_timeout': (0.0, 1.0),
    'reference_timeout': (0.0, 1.0),
    'hold_time': (0.0, 1.0),
    'max_dt': (0.02, 10.0),
    'good_samples': (1, 10),
    'stall_time': (0.0, 10.0),
    'stall_action': ('warn', 'fault'),
}


class Loop:
    """Two controllers in the same loop around one chain, until one of them is changed."""

    def __init__(self, settings: ControllerSettings, ticks: int, seed: int = 1) -> None:
        self.noise = noise(seed, 1000, 0.01)
        self.chain = Chain(settings.plant_order)
        self.controllers = [Controller(settings, checked=True)]
        self.ticks, self.time = 0, 0.0
        for _ in range(ticks):
            self.tick()
        self.controllers.append(loads(dumps(self.controllers[0])))

    def tick(self) -> list[float]:
        y = self.chain.y + self.noise[self.ticks]
        self.ticks += 1
        self.time += H
        r = [2.0 + 0.3 * self.time, 0.3]
        commands = [c.tick(y, H, reference=r) for c in self.controllers]
        self.chain.advance(commands[-1] * self.controllers[0].design.b0 + 0.7, H)
        return commands


def changes(case: str) -> list[tuple[str, ControllerSettings, ControllerSettings]]:
    base = ControllerSettings(**CASES[case])
    found = []
    for name, values in VALUES.items():
        for value in values:
            if name == 'b0':
                value = copysign(value, base.b0)
            if name == 'b0_table':
                value = signed(value, base.b0)
            try:
                found.append((f'{name}={value}', base, attrs.evolve(base, **{name: value})))
            except SettingError as error:
                # Of an angle not everything can be.
                assert error.name in ('plant_poles', 'error_deadband')
                assert base.measurement_period > 0.0
    return found


def signed(table: tuple[float, ...], b0: float) -> tuple[float, ...]:
    """Return the table with the sign of ``b0``."""
    return tuple(copysign(v, b0) if i % 2 else v for i, v in enumerate(table))


def test_every_live_setting_is_changed_below() -> None:
    assert set(VALUES) == set(FIELDS)


@pytest.mark.parametrize('ticks', (1, 4, 60))
@pytest.mark.parametrize('case', CASES)
def test_p12_a_change_of_any_live_setting_is_bumpless(case: str, ticks: int) -> None:
    statuses: set[Status] = set()
    frozen = dumps(Loop(ControllerSettings(**CASES[case]), ticks))  # quicker than deepcopy
    for label, base, changed in changes(case):
        loop = loads(frozen)
        kept, retuned = loop.controllers
        applied = kept.command
        retuned.retune(changed)
        if changed.command_rate_limit and not base.command_rate_limit:
            continue  # a narrowed limit: see below
        old, new = loop.tick()
        assert retuned.settings == changed, label
        # The same command in the tick of the change, ...
        assert new == pytest.approx(old, rel=1e-12, abs=1e-9), label
        # ... and the new law, on the state handed over, asks for it as well.
        asked = raw_command(retuned.design, retuned.state)
        scale = 1e-15 * abs(asked * retuned.design.b0) / min(1.0, abs(retuned.design.b0))
        now = limit(retuned.design, asked, applied, H)[0]
        assert now == pytest.approx(old, abs=1e-9 + scale), label
        statuses.add(kept.status)
        loop.controllers.remove(kept)
        for _ in range(4):
            (u,) = loop.tick()
            assert changed.command_min <= u <= changed.command_max, label
            assert retuned.status < Status.NO_MEASUREMENT, label
    assert statuses


def test_p12_the_changes_above_meet_every_state_of_the_limiter() -> None:
    seen = set()
    for case in CASES:
        loop = Loop(ControllerSettings(**CASES[case]), 1)
        for _ in range(150):
            loop.tick()
            seen.add(loop.controllers[0].status)
    assert seen == {Status.OK, Status.RATE_LIMITED, Status.SATURATED}


@pytest.mark.parametrize('case', CASES)
def test_a_change_that_changes_nothing_changes_no_later_command(case: str) -> None:
    loop = Loop(ControllerSettings(**CASES[case]), 40)
    loop.controllers[1].retune(ControllerSettings(**CASES[case]))
    for _ in range(200):
        old, new = loop.tick()
        assert new == pytest.approx(old, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize('case', CASES)
def test_p02_p05_narrowed_limits_are_entered_at_once(case: str) -> None:
    base = ControllerSettings(**CASES[case])
    for low, high in ((-1.0, 1.0), (3.0, 4.0), (-9.0, -8.0)):
        loop = Loop(base, 40)
        narrow = attrs.evolve(base, command_min=low, command_max=high, safe_command=low)
        loop.controllers[1].retune(narrow)
        for _ in range(50):
            assert low <= loop.tick()[1] <= high


@pytest.mark.parametrize('case', CASES)
def test_p05_a_new_rate_limit_holds_from_the_next_tick(case: str) -> None:
    loop = Loop(ControllerSettings(**CASES[case]), 40)
    loop.controllers[1].retune(
        attrs.evolve(loop.controllers[1].settings, command_rate_limit=3.0, structure='printed')
        if len(CASES[case].get('pole_ratios', ())) < 2
        else attrs.evolve(loop.controllers[1].settings, command_rate_limit=3.0)
    )
    before = loop.tick()[1]
    for _ in range(100):
        u = loop.tick()[1]
        assert abs(u - before) <= 3.0 * H * (1 + 1e-9)
        before = u


@pytest.mark.parametrize('structure', NAMES)
def test_p05_a_switch_of_structure_keeps_the_rate_limit(structure: str) -> None:
    base = ControllerSettings(structure=structure, command_rate_limit=20.0)
    loop = Loop(base, 20)
    before = loop.controllers[1].command
    for k in range(200):
        if k % 7 == 0:
            loop.controllers[1].retune(attrs.evolve(base, structure=NAMES[k // 7 % len(NAMES)]))
        u = loop.tick()[1]
        assert abs(u - before) <= 20.0 * H * (1 + 1e-9)
        before = u


def test_one_at_a_time_changes_never_leave_the_finite() -> None:
    """A walk through the settings, extreme values too, each from wherever the last one led."""
    extremes: dict[str, tuple[Any, ...]] = {
        name: (f.low, f.high, f.default)
        if f.kind in ('number', 'integer')
        else ((f.low,), (f.high,), f.default)
        if f.kind == 'numbers'
        else f.choices or (True, False)
        for name, f in FIELDS.items()
    }
    refused = 0
    for seed in range(3):
        loop = Loop(ControllerSettings(), 10, seed)
        names = random.Random(seed).sample(sorted(FIELDS), len(FIELDS))
        for turn in range(3):
            for name in names:
                options = extremes[name] if turn % 2 else VALUES[name]
                controller = loop.controllers[1]
                try:
                    wanted = attrs.evolve(
                        controller.settings, **{name: options[turn % len(options)]}
                    )
                except SettingError:
                    refused += 1
                    continue
                try:
                    controller.retune(wanted)
                except SettingError:  # another sign of b0
                    refused += 1
                    continue
                for _ in range(4):
                    u = loop.tick()[1]
                    assert isfinite(u)
                    assert controller.design.command_min <= u <= controller.design.command_max
                assert controller.settings == wanted
                rows = [*controller.state.levels, controller.state.profile]
                assert all(isfinite(x) for row in rows for x in row), name
    assert refused < 25


@pytest.mark.parametrize(
    ('name', 'value'), (('plant_order', 3), ('reference_derivatives', 'none'))
)
def test_p13_what_is_fixed_at_start_is_refused_by_name(name: str, value: Any) -> None:
    controller = Controller(ControllerSettings())
    with pytest.raises(SettingError) as refused:
        controller.retune(ControllerSettings(**{name: value}))
    assert refused.value.name == name
    controller.tick(0.0, H)
    assert controller.settings == ControllerSettings()


def test_p12_the_last_change_before_a_tick_is_the_one_taken() -> None:
    controller = Controller(ControllerSettings())
    for _ in range(5):
        controller.tick(0.1, H, reference=[1.0])
    controller.retune(ControllerSettings(b0=5.0))
    controller.retune(ControllerSettings(b0=7.0))
    assert controller.settings.b0 == controller.design.b0 == 1.0
    controller.tick(0.1, H)
    assert controller.settings.b0 == controller.design.b0 == 7.0


@pytest.mark.parametrize('case', [case for case in CASES if 'td' not in case])
def test_p12_a_change_keeps_the_sum_of_the_estimates(case: str) -> None:
    """What the levels that go away had estimated is not forgotten; of a new model L is another."""
    chosen = [it for it in changes(case) if not it[0].startswith(('b0', 'plant', 'tracking'))]
    assert len(chosen) > len(VALUES)
    frozen = dumps(Loop(chosen[0][1], 40))
    for label, _, changed in chosen:
        loop = loads(frozen)
        kept, retuned = loop.controllers
        retuned.retune(changed)
        loop.tick()
        assert retuned.total_disturbance == pytest.approx(kept.total_disturbance), label


@pytest.mark.parametrize('error_based', (False, True))
def test_p12_the_estimate_is_of_the_plant_whatever_is_observed(error_based: bool) -> None:
    """The sum of the levels alone differs by r^(n), which is not 0 here."""
    settings = ControllerSettings(plant_order=1, error_based=error_based)
    loop = Loop(settings, 100)
    kept, retuned = loop.controllers
    retuned.retune(attrs.evolve(settings, error_based=not error_based))
    loop.tick()
    assert retuned.total_disturbance == pytest.approx(kept.total_disturbance, abs=1e-9)


def test_p12_switched_off_the_differentiator_leaves_no_bump_for_the_next_tick() -> None:
    """The reference is far ahead of the profile, by 32 in the command."""
    settings = ControllerSettings(tracking_acceleration=0.1)
    loop = Loop(settings, 20)
    loop.controllers[1].retune(attrs.evolve(settings, tracking_acceleration=0.0))
    loop.tick()
    old, new = loop.tick()
    assert abs(new - old) < 5.0


def test_p12_a_change_is_no_start_of_the_observers() -> None:
    """Whose bandwidths would rise from 0 again."""
    settings = ControllerSettings(startup_time=1.0)
    loop = Loop(settings, 150)
    kept, retuned = loop.controllers
    retuned.retune(attrs.evolve(settings, hold_time=1.0))
    for _ in range(50):
        loop.tick()
    assert retuned.total_disturbance == pytest.approx(kept.total_disturbance)
    assert retuned.state.startup == kept.state.startup


@pytest.mark.parametrize('structure', NAMES)
@pytest.mark.parametrize('change', (None, {'b0': 3.0}, {'levels': 1}, {'structure': 'printed'}))
def test_a_transfer_leaves_no_trace(structure: str, change: dict[str, Any] | None) -> None:
    """At rest the loop stays at rest through it; None is disabling and enabling again."""
    settings = ControllerSettings(structure=structure, safe_command=-2.0)
    controller, chain = Controller(settings), Chain(2)
    for k in range(1200):
        if k == 1000 and change is not None:
            controller.retune(attrs.evolve(settings, **change))
        controller.enabled = change is not None or k != 1000
        chain.advance(controller.tick(chain.y, H, reference=[1.0]) + 2.0, H)
        assert k < 1000 or chain.y == pytest.approx(1.0, abs=1e-6)
    assert controller.command == pytest.approx(-2.0, abs=1e-6)


def test_p12_a_change_in_a_fault_waits_for_no_sample() -> None:
    controller = Controller(ControllerSettings())
    for _ in range(5):
        controller.tick(0.1, H, reference=[1.0])
    before = controller.command
    controller.retune(ControllerSettings(structure='cascade', b0=3.0))
    assert controller.tick(float('nan'), H) == before
    assert controller.settings.structure == 'cascade'
    controller.tick(0.1, H)
    assert abs(controller.command - before) < 20.0


@pytest.mark.parametrize(
    'values',
    ({}, {'tracking_acceleration': 5.0}, {'tracking_acceleration': 5.0, 'error_based': True}),
)
def test_p12_fewer_good_samples_end_no_fault_before_the_next_sample(values: Any) -> None:
    settings = ControllerSettings(good_samples=20, measurement_timeout=0.1, **values)
    controller = Controller(settings)
    chain = Chain(2)

    def run(ticks: int) -> None:
        for _ in range(ticks):
            chain.advance(controller.tick(chain.y, H), H)

    run(50)  # there is no reference: the first measurement is held
    for _ in range(20):
        controller.tick(nan, 0.0, elapsed=H)
    run(8)
    assert controller.cause == Cause.MEASUREMENT_TIMEOUT
    controller.retune(attrs.evolve(settings, good_samples=3))
    for _ in range(3):
        controller.tick(nan, 0.0, elapsed=H)
        assert controller.mode != Mode.OK
    run(1)
    assert controller.mode == Mode.OK
    assert all(map(isfinite, [*controller.reference, *controller.state.profile]))
    run(10)
    assert controller.mode == Mode.OK and controller.counts[Status.RESTARTED] == 0


def test_p13_another_sign_of_b0_is_refused_until_the_loop_is_open() -> None:
    controller = Controller(ControllerSettings())
    controller.tick(0.1, H, reference=[0.0])
    turned = attrs.evolve(controller.settings, b0=-1.0)
    with pytest.raises(SettingError, match=r'b0 = -1\.0: must be of the sign it has'):
        controller.retune(turned)
    controller.enabled = False
    controller.retune(turned)
    controller.tick(0.1, H)
    assert controller.settings.b0 == -1.0


def test_p12_after_a_gap_a_change_is_measured_by_the_limit_that_acted() -> None:
    """Old and new settings ask for more than the rate limit leaves one tick: no bump to hide."""
    settings = ControllerSettings(plant_order=1, command_rate_limit=1.0)
    controller = Controller(settings, checked=True)
    for _ in range(20):
        controller.tick(0.0, H, reference=[0.0])
    for _ in range(9):
        controller.tick(elapsed=H)
    controller.retune(attrs.evolve(settings, controller_bandwidth=8.0))
    command = controller.tick(0.0, 10.0 * H, elapsed=H, reference=[0.0125])
    assert command == pytest.approx(1.0 * H)
    assert controller.state.offset == [0.0, 0.0, 0.0]
