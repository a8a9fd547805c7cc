"""The fault policy as a table: every state against every cause that may be present."""

from __future__ import annotations

from itertools import product
from math import inf

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.supervisor import Cause, Mode, supervise, Watch
import pytest

H = 0.01
DESIGN = make_design(
    ControllerSettings(
        measurement_timeout=0.1, reference_timeout=0.2, hold_time=0.05, good_samples=3
    )
)
NONE, REFERENCE, MEASUREMENT, START, DISABLED = Cause
OK, HOLDING, RAMPING, SAFE = Mode
# What makes each cause present: enabled, measured, and the ages of both before the tick.
PRESENT = {
    NONE: (True, True, 0.0, 0.0),
    REFERENCE: (True, True, 0.0, 1.0),
    MEASUREMENT: (True, False, 1.0, 0.0),
    START: (True, False, inf, 0.0),
    DISABLED: (False, True, 0.0, 0.0),
}
# The mode that a cause asks for when it appears.
ENTRY = {NONE: OK, REFERENCE: HOLDING, MEASUREMENT: HOLDING, START: SAFE, DISABLED: RAMPING}
# Row: the cause that acts. Column: the cause that is present now. Entry: the one that acts then.
# The most severe acts until the fault ends; switched on again, a controller is not disabled.
NEXT = {
    NONE: (NONE, REFERENCE, MEASUREMENT, START, DISABLED),
    REFERENCE: (REFERENCE, REFERENCE, MEASUREMENT, START, DISABLED),
    MEASUREMENT: (MEASUREMENT, MEASUREMENT, MEASUREMENT, START, DISABLED),
    START: (NONE, START, START, START, DISABLED),
    DISABLED: (NONE, REFERENCE, MEASUREMENT, START, DISABLED),
}
FAULTS = [(mode, cause) for mode, cause in product(Mode, Cause) if (mode == OK) == (cause == NONE)]


def after(mode: Mode, cause: Cause, present: Cause, **more: float) -> Watch:
    """Return the state one tick after ``present`` was there."""
    enabled, measured, measurement_age, reference_age = PRESENT[present]
    more.setdefault('lost', cause in (REFERENCE, MEASUREMENT))
    before = Watch(mode, cause, measurement_age, reference_age, **more)  # type: ignore[arg-type]
    referenced = present != REFERENCE
    return supervise(DESIGN, before, enabled, measured, referenced, False, H, H, 0.0)


@pytest.mark.parametrize('present', Cause)
@pytest.mark.parametrize(('mode', 'cause'), FAULTS)
def test_p19_of_every_pair_of_causes_the_most_severe_acts(
    mode: Mode, cause: Cause, present: Cause
) -> None:
    watch = after(mode, cause, present)
    assert Cause(watch.cause) == NEXT[cause][present]
    ended = watch.cause == NONE
    assert Mode(watch.mode) == (OK if ended else max(mode, ENTRY[present]))


@pytest.mark.parametrize(('mode', 'cause'), [pair for pair in FAULTS if pair[0] != OK])
def test_p19_a_fault_ends_after_its_good_samples(mode: Mode, cause: Cause) -> None:
    needed = DESIGN.good_samples if cause in (REFERENCE, MEASUREMENT) else 1
    for good in range(needed):
        watch = after(mode, cause, NONE, good=good)
        assert (watch.mode == OK) == (good + 1 == needed)


@pytest.mark.parametrize('lost', (False, True))
def test_p19_what_was_lost_is_not_forgotten_while_disabled(lost: bool) -> None:
    watch = after(HOLDING if lost else OK, MEASUREMENT if lost else NONE, DISABLED)
    assert (watch.cause, watch.lost) == (DISABLED, lost)
    back = supervise(DESIGN, watch, True, True, True, False, H, H, 0.0)
    assert (back.mode == OK) == (not lost)


def test_a_restart_of_the_observers_alone_never_ramps() -> None:
    before = Watch(HOLDING, NONE, 0.0, 0.0, fault_age=1.0)
    assert supervise(DESIGN, before, True, False, True, False, 0.0, H, 0.0).mode == HOLDING


def test_p19_a_bad_sample_in_between_starts_the_count_again() -> None:
    enabled, _, measurement_age, reference_age = PRESENT[NONE]
    before = Watch(RAMPING, MEASUREMENT, measurement_age, reference_age, good=2, lost=True)
    bad = supervise(DESIGN, before, enabled, False, True, False, H, H, 0.0)
    assert bad.good == 0
    none_came = supervise(DESIGN, before, enabled, False, True, False, 0.0, H, 0.0)
    assert none_came.good == 2


def test_p19_a_fault_does_not_end_without_a_sample_whatever_was_good() -> None:
    before = Watch(HOLDING, MEASUREMENT, 0.0, 0.0, good=8, lost=True)
    assert supervise(DESIGN, before, True, False, True, False, 0.0, H, 0.0).mode == HOLDING
    assert supervise(DESIGN, before, True, True, True, False, H, H, 0.0).mode == OK


@pytest.mark.parametrize('cause', (REFERENCE, MEASUREMENT))
def test_p07_holding_ends_with_the_hold_time_and_ramping_at_safe(cause: Cause) -> None:
    enabled, measured, measurement_age, reference_age = PRESENT[cause]
    for held, mode in ((0.03, HOLDING), (0.06, RAMPING)):
        before = Watch(HOLDING, cause, measurement_age, reference_age, fault_age=held - H)
        assert supervise(DESIGN, before, enabled, measured, False, False, H, H, 0.0).mode == mode
    for at_safe, mode in ((False, RAMPING), (True, SAFE)):
        before = Watch(RAMPING, cause, measurement_age, reference_age)
        assert supervise(DESIGN, before, enabled, measured, False, at_safe, H, H, 0.0).mode == mode


def test_a_controller_begins_where_the_table_says() -> None:
    controller = Controller(ControllerSettings())
    assert (controller.mode, controller.cause) == (SAFE, START)
