"""A controller as a managed node, whatever is asked of it in which order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import product
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.managed import managed
from probe import INTERRUPTS, Probe, Processes
import pytest
from rclpy.impl.implementation_singleton import rclpy_implementation
from test_commission_node import EXPERIMENT

Make = Callable[..., Probe]
SAFE = 1.5
CONTROL: dict[str, Any] = {
    'rate': 100.0,
    'plant_order': 1,
    'good_samples': 1,
    'command_min': -5.0,
    'safe_command': SAFE,
    'share_command': True,
}
# What a state allows, and where that leads; all else is refused.
LEADS = {
    ('unconfigured', 'configure'): 'inactive',
    ('inactive', 'activate'): 'active',
    ('active', 'deactivate'): 'inactive',
    ('inactive', 'cleanup'): 'unconfigured',
    **{(state, 'shutdown'): 'finalized' for state in ('unconfigured', 'inactive', 'active')},
    ('inactive', 'enable'): 'active',
    ('active', 'enable'): 'active',
    ('active', 'disable'): 'inactive',
}
LABELS = ('configure', 'cleanup', 'activate', 'deactivate', 'shutdown')
BACK = {'active': ('deactivate', 'cleanup'), 'inactive': ('cleanup',), 'unconfigured': ()}
THERE = {'active': ('configure', 'activate'), 'inactive': ('configure',), 'unconfigured': ()}
LENGTH = 6


class Life:
    """A managed controller whose sensor says the same all the time, and what it sends."""

    def __init__(self, node: Any) -> None:
        self.node = node
        self.sent: list[float] = []
        send = node._command.send

        def spy(value: float, stamp: int = 0) -> None:
            self.sent.append(value)
            send(value, stamp)

        node._command.send = spy

    @property
    def state(self) -> tuple[Any, ...]:
        controller = self.node.controller
        return self.node.lifecycle, controller.enabled, controller.policy[:2], self.node._silent

    def ask(self, label: str, number: int = 0) -> bool:
        if label in ('enable', 'disable'):
            return bool(self.node.enable(label == 'enable')[0])
        request = ChangeState.Request(transition=Transition(id=number, label=label))
        answer = self.node._service_change_state.callback(request, ChangeState.Response())
        return bool(answer.success)

    def ticks(self, count: int = 3) -> list[float]:
        """Let some periods pass, and return what was sent in them."""
        self.sent.clear()
        for _ in range(count):
            self.node._take_sample(0.2, 0.01, 0.01, [1.0])
        return self.sent

    def check(self) -> None:
        """Compare what is sent with the state."""
        sent = self.ticks()
        if self.node.lifecycle == 'active':
            assert len(sent) == 3 and sent[-1] != SAFE and self.node.controller.enabled
        else:
            assert set(sent) <= {SAFE} and not self.node.controller.enabled
            assert not self.ticks(1)  # silent by now

    def begin_anew(self) -> None:
        """Be unconfigured again, which who is finalized cannot be asked to be."""
        self.node._state_machine = rclpy_implementation.LifecycleStateMachine(
            self.node.handle, False
        )

    def go(self, state: str) -> None:
        """Go to a state on the shortest way."""
        if self.node.lifecycle == 'finalized':
            self.begin_anew()
        way = () if self.node.lifecycle == state else BACK[self.node.lifecycle] + THERE[state]
        assert all(map(self.ask, way))
        self.ticks()

    def walk(self, labels: tuple[str, ...], length: int) -> int:
        """Ask for each of the labels, and after each for all sequences that are one shorter."""
        before, count = self.state, 0
        for label in labels:
            if self.state != before:
                self.go(before[0])
            assert self.state == before
            goal = LEADS.get((before[0], label))
            assert self.ask(label) == (goal is not None or label == 'disable')
            assert self.node.lifecycle == (goal or before[0])
            assert goal or self.state == before
            self.check()
            count += 1
            # what is final stays: one more request of each kind stands for all sequences
            left = min(length - 1, 1) if goal == 'finalized' else length - 1
            if left:
                count += self.walk(labels, left)
        return count


@pytest.fixture
def life(make_probe: Make) -> Iterator[Life]:
    probe = make_probe(parameters={'controller': CONTROL})
    life = Life(probe.add(managed(ControllerNode)()))
    life.ticks()  # it has measurements
    yield life


def test_p25_whatever_transitions_are_asked_for_the_command_is_safe_unless_it_is_active(
    life: Life,
) -> None:
    """All sequences up to a length of six."""
    assert life.walk(LABELS, LENGTH) > 6000


def test_p25_enable_activates_and_deactivates_what_is_configured(life: Life) -> None:
    assert life.walk((*LABELS, 'enable', 'disable'), 3) > 200
    life.go('unconfigured')
    assert 'configure it first' in life.node.enable(True)[1]
    life.go('active')
    life.ask('shutdown')
    assert 'start it again' in life.node.enable(True)[1]


@pytest.mark.parametrize('state', ['unconfigured', 'inactive', 'active', 'finalized'])
def test_p25_no_other_transition_changes_anything(life: Life, state: str) -> None:
    """One that does not exist, or is for the node itself to do."""
    life.go('active' if state == 'finalized' else state)
    assert state != 'finalized' or life.ask('shutdown')
    life.ticks()
    before = life.state
    for number, label in product((0, 8, 9, 10, 11, 12, 30, 60, 62, 255), ('', 'transition_error')):
        assert not life.ask(label, number)
    assert not life.ask('Configure', Transition.TRANSITION_CONFIGURE)
    assert life.state == before
    life.check()


def test_who_loses_the_loop_is_inactive(life: Life) -> None:
    """By a lease that runs out, by giving way, and by an error, which ends the process."""
    node = life.node
    for lose in (node._on_lease_over, lambda: node._set_enabled(False), node.begin_stop):
        life.go('active')
        lose()
        assert node.lifecycle == 'inactive'
        life.check()
    assert not node.failure


def test_an_error_while_activating_ends_the_node_with_its_safe_command(
    life: Life, monkeypatch: pytest.MonkeyPatch
) -> None:
    life.go('inactive')
    monkeypatch.setattr(life.node._rivals, 'settle', lambda on: 1 / 0)
    assert not life.ask('activate')
    assert 'ZeroDivisionError' in life.node.failure and life.node.finished
    assert life.node.lifecycle == 'unconfigured'
    life.check()


def test_who_may_not_take_over_stays_inactive(life: Life, monkeypatch: pytest.MonkeyPatch) -> None:
    life.go('inactive')
    monkeypatch.setattr(life.node._rivals, 'refusal', lambda: 'another one commands')
    before = life.state
    assert not life.ask('activate')
    assert life.state == before
    life.check()


def test_a_managed_controller_is_open_at_first_and_makes_no_experiments(life: Life) -> None:
    assert life.node.lifecycle == 'unconfigured'
    assert life.node.get_parameter('enabled_at_start').value is False
    assert life.node.report()[2]['lifecycle'] == 'unconfigured'
    with pytest.raises(UserError, match='without --managed'):
        life.node._commission._start(EXPERIMENT)


def test_what_is_managed_is_in_real_time(make_probe: Make) -> None:
    probe = make_probe(parameters={'controller': {'pacing': 'lockstep', 'steps': 9}})
    with pytest.raises(UserError, match=r'realtime with --managed'):
        probe.add(managed(ControllerNode)())


@pytest.mark.parametrize('number', INTERRUPTS[:2])
def test_p25_as_a_process_it_answers_every_request_and_ends_as_any_controller(
    start: Processes, probe: Probe, number: int
) -> None:
    controller = start('controller', '--', '--managed', **CONTROL)
    commands = probe.listen('command')
    feed, refer = probe.publisher('measurement'), probe.publisher('reference')

    def ask(label: str) -> bool:
        request = ChangeState.Request(transition=Transition(label=label))
        return bool(probe.call(ChangeState, 'controller/change_state', request).success)

    def state() -> str:
        answer = probe.call(GetState, 'controller/get_state', GetState.Request())
        return str(answer.current_state.label)

    assert state() == 'unconfigured' and not probe.enable().success
    assert [ask(label) for label in ('activate', 'configure', 'configure')] == [False, True, False]
    assert state() == 'inactive' and not commands
    assert probe.enable().success and state() == 'active'

    def commanded() -> bool:
        feed(0.2)
        refer(1.0)
        return bool(commands) and commands[-1] != SAFE

    probe.wait_until(commanded)
    assert ask('deactivate') and state() == 'inactive'
    probe.wait_until(lambda: commands[-1] == SAFE)
    assert ask('activate')
    probe.wait_until(commanded)
    controller.signal(number)
    assert probe.end_of(controller) == 0 and commands[-1] == SAFE
