"""The fault policy as a table: every state against every cause that may be present."""

from __future__ import annotations

from itertools import product
from math import inf, nan

from nadrc_ros.adrc.controller import Controller
from nadrc_ros.adrc.design import make_design
from nadrc_ros.adrc.sample import Sample
from nadrc_ros.adrc.settings import ControllerSettings
from nadrc_ros.adrc.status import Cause, Mode
from nadrc_ros.adrc.supervisor import PolicyState, Stall, supervise
import pytest

H = 0.01
DESIGN = make_design(
    ControllerSettings(
        measurement_timeout=0.1,
        reference_timeout=0.2,
        hold_time=0.05,
        good_samples=3,
        stall_time=0.5,
        stall_action='fault',
    )
)
SAFE_COMMAND, ELSEWHERE = DESIGN.safe_command, 1.0
NONE, NOT_FOLLOWED, REFERENCE, STALLED, MEASUREMENT, START, DISABLED = Cause
OK, HOLDING, RAMPING, SAFE = Mode
# What makes each cause present: enabled, measured, time of a stall, ages of both before the tick.
PRESENT = {
    NONE: (True, True, 0.0, 0.0, 0.0),
    NOT_FOLLOWED: (True, True, 0.0, 0.0, 0.0),
    REFERENCE: (True, True, 0.0, 0.0, 1.0),
    STALLED: (True, True, 1.0, 0.0, 0.0),
    MEASUREMENT: (True, False, 0.0, 1.0, 0.0),
    START: (True, False, 0.0, inf, 0.0),
    DISABLED: (False, True, 0.0, 0.0, 0.0),
}
# The mode that a cause asks for when it appears.
ENTRY = {
    NONE: OK,
    NOT_FOLLOWED: HOLDING,
    REFERENCE: HOLDING,
    STALLED: HOLDING,
    MEASUREMENT: HOLDING,
    START: SAFE,
    DISABLED: RAMPING,
}
# Row: the cause that acts. Column: the cause that is present now. Entry: the one that acts then.
# The most severe acts until the fault ends; switched on again, a controller is not disabled.
NEXT = {
    NONE: (NONE, NOT_FOLLOWED, REFERENCE, STALLED, MEASUREMENT, START, DISABLED),
    NOT_FOLLOWED: (NOT_FOLLOWED, NOT_FOLLOWED, REFERENCE, STALLED, MEASUREMENT, START, DISABLED),
    REFERENCE: (REFERENCE, REFERENCE, REFERENCE, STALLED, MEASUREMENT, START, DISABLED),
    STALLED: (STALLED, STALLED, STALLED, STALLED, MEASUREMENT, START, DISABLED),
    MEASUREMENT: (*[MEASUREMENT] * 5, START, DISABLED),
    START: (*[START] * 6, DISABLED),
    DISABLED: (DISABLED, NOT_FOLLOWED, REFERENCE, STALLED, MEASUREMENT, START, DISABLED),
}
FAULTS = [(mode, cause) for mode, cause in product(Mode, Cause) if (mode == OK) == (cause == NONE)]


def after(
    policy: PolicyState, present: Cause = NONE, *, at_safe: bool = False, odd: bool = False
) -> PolicyState:
    """Return the state one tick after ``present`` was there."""
    enabled, measured, stalled, measurement_age, reference_age = PRESENT[present]
    before = policy._replace(
        measurement_age=measurement_age,
        reference_age=reference_age,
        stall=Stall(stalled=stalled, aim=2.0, distance=2.0),
    )
    y = 1.0 if odd else 0.0
    applied = SAFE_COMMAND if at_safe else ELSEWHERE
    sample = Sample(y if measured else nan, H, H, 0.0, applied, present != NOT_FOLLOWED)
    referenced, limited = present != REFERENCE, present == STALLED
    return supervise(DESIGN, before, sample, measured, referenced, enabled, limited, 0.0, y)


@pytest.mark.parametrize('present', Cause)
@pytest.mark.parametrize(('mode', 'cause'), FAULTS)
def test_p19_of_every_pair_of_causes_the_most_severe_acts(
    mode: Mode, cause: Cause, present: Cause
) -> None:
    policy = after(PolicyState(mode, cause), present)
    assert Cause(policy.cause) == NEXT[cause][present]
    ended = policy.cause == NONE
    expected = OK if ended else max(mode, ENTRY[present])
    if (expected, present) == (RAMPING, NOT_FOLLOWED):  # no ramp of what nothing follows
        expected = SAFE
    assert Mode(policy.mode) == expected


@pytest.mark.parametrize(('mode', 'cause'), [pair for pair in FAULTS if pair[0] != OK])
def test_p19_a_fault_ends_after_its_good_samples(mode: Mode, cause: Cause) -> None:
    for good in range(DESIGN.good_samples):
        policy = after(PolicyState(mode, cause, good=good))
        assert (policy.mode == OK) == (good + 1 == DESIGN.good_samples)


@pytest.mark.parametrize(('mode', 'cause'), [pair for pair in FAULTS if pair[0] != OK])
def test_p08_no_fault_ends_at_an_odd_sample(mode: Mode, cause: Cause) -> None:
    policy = after(PolicyState(mode, cause, good=10, last=0.0, spread=0.49), odd=True)
    assert policy.mode != OK
    assert after(policy).mode == OK
    assert after(PolicyState(mode, cause, good=10, last=0.0, spread=0.51), odd=True).mode == OK


@pytest.mark.parametrize('present', (REFERENCE, STALLED, MEASUREMENT))
def test_p19_what_was_lost_is_not_forgotten_while_disabled(present: Cause) -> None:
    """The good samples count from the fault, not from before it."""
    faulty = after(PolicyState(OK, NONE, good=10), present)
    disabled = after(faulty, DISABLED)
    assert (disabled.cause, disabled.good) == (DISABLED, 1)
    assert after(disabled).mode != OK
    assert after(after(disabled)).mode == OK


def test_p11_enabled_beside_a_working_sensor_the_law_acts_at_once() -> None:
    assert after(after(PolicyState(OK, NONE, good=10), DISABLED)).mode == OK


def test_p19_a_bad_sample_in_between_starts_the_count_again() -> None:
    before = PolicyState(RAMPING, MEASUREMENT, 0.0, 0.0, good=2)
    bad = Sample(nan, H, H, 0.0, ELSEWHERE)
    assert supervise(DESIGN, before, bad, False, True, True, False, 0.0, nan).good == 0
    none_came = bad._replace(span=0.0)
    assert supervise(DESIGN, before, none_came, False, True, True, False, 0.0, nan).good == 2


def test_p19_a_fault_does_not_end_without_a_sample_whatever_was_good() -> None:
    before = PolicyState(HOLDING, MEASUREMENT, 0.0, 0.0, good=8)
    none_came = Sample(nan, 0.0, H, 0.0, ELSEWHERE)
    assert supervise(DESIGN, before, none_came, False, True, True, False, 0.0, nan).mode == HOLDING
    assert after(before).mode == OK


@pytest.mark.parametrize('cause', (REFERENCE, STALLED, MEASUREMENT))
def test_p07_holding_ends_with_the_hold_time_and_ramping_at_safe(cause: Cause) -> None:
    for held, mode in ((0.03, HOLDING), (0.06, RAMPING)):
        assert after(PolicyState(HOLDING, cause, fault_age=held - H), cause).mode == mode
    for at_safe, mode in ((False, RAMPING), (True, SAFE)):
        assert after(PolicyState(RAMPING, cause), cause, at_safe=at_safe).mode == mode


@pytest.mark.parametrize(('mode', 'cause'), FAULTS)
def test_p11_what_is_only_not_followed_waits_to_go_on_from_where_the_inner_loop_is(
    mode: Mode, cause: Cause
) -> None:
    policy = after(PolicyState(mode, cause, good=10, fault_age=9.0), NOT_FOLLOWED)
    for _ in range(20):
        assert (policy.mode, policy.cause) == (HOLDING, NOT_FOLLOWED)
        policy = after(policy, NOT_FOLLOWED)
    assert after(policy, MEASUREMENT).fault_age == 0.0  # it is held as long as any other
    assert after(policy).mode == OK


def test_a_controller_begins_where_the_table_says() -> None:
    controller = Controller(ControllerSettings())
    assert (controller.mode, controller.cause) == (SAFE, START)
