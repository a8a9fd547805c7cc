"""Who commands: a second controller does not take over from one that does, and a standby can."""

from __future__ import annotations

from collections.abc import Callable
import signal
from typing import Any

from nadrc_ros.adrc.status import Mode
from nadrc_ros.nodes import rivals
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.nodes.plant import PlantNode
from nadrc_ros.ros import graph
from nadrc_ros.ros.diagnostics import ERROR, OK, receive_events, WARN
from probe import Probe, Processes
import pytest

Make = Callable[..., Probe]
RATE = 50.0
PLANT: dict[str, Any] = {'rate': RATE, 'plant': 'chain', 'order': 1}
CONTROL: dict[str, Any] = {
    'rate': RATE,
    'plant_order': 1,
    'b0': 1.0,
    'inner_bandwidth': 15.0,
    'outer_bandwidth': 15.0,
    'safe_command': 1.5,
}
THEIRS = 7.25
# commands that a controller sends within the time in which it gives way
MANY = 400


def rival(probe: Probe, period: float = 0.002) -> Any:
    """Let the probe command, and return the timer that does it."""
    command = probe.publisher('command')
    return probe.node.create_timer(period, lambda: command(THEIRS))


def test_who_is_second_does_not_send_a_single_command_until_enabled(probe: Probe) -> None:
    commands, timer = probe.listen('command'), rival(probe)
    probe.wait_until(lambda: len(commands) > 2)
    probe.add(PlantNode(parameters=PLANT))
    node = probe.add(ControllerNode(parameters=CONTROL))
    probe.wait_until(lambda: not node.controller.enabled)
    probe.wait_until(lambda: probe.said() and probe.said()[-1][0] == ERROR)
    topic = f'{probe.namespace}/command'
    told = f'{probe.namespace}/probe commands on {topic}: this controller is disabled and silent'
    assert told in probe.said()[-1][1]
    answer = probe.enable()
    assert not answer.success
    assert answer.message.startswith(f'{probe.namespace}/probe commands on {topic}: disable it')
    assert set(commands) == {THEIRS}
    timer.cancel()
    probe.wait_until(lambda: probe.enable().success)
    probe.wait_until(lambda: node.controller.mode == Mode.OK)
    assert commands[commands.index(1.5) :].count(THEIRS) == 0
    probe.wait_until(lambda: probe.said()[-1][0] != ERROR)


def test_who_began_shortly_before_it_hears_another_gives_way_and_is_silent_at_once(
    probe: Probe,
) -> None:
    """Discovery may take three seconds."""
    commands, timer = probe.listen('command'), rival(probe)
    probe.wait_until(lambda: len(commands) > MANY)
    timer.cancel()
    load = {'damping': 0.0, 'disturbance': 'constant', 'disturbance_offset': 5.0}
    probe.add(PlantNode(parameters=PLANT | load | {'command_timeout': 0.0}))
    node = probe.add(ControllerNode(parameters=CONTROL | {'command_rate_limit': 20.0}))
    probe.wait_until(lambda: commands[-1] < -4.0)  # a ramp to safe is seen
    timer.reset()
    probe.wait_until(lambda: not node.controller.enabled)
    n = len(commands)
    probe.wait_until(lambda: len(commands) > n + 2)
    assert set(commands[n:]) == {THEIRS}
    node.begin_stop()
    assert node.stopped
    node.close()
    timer.cancel()
    probe.spin(0.1)
    assert set(commands[n:]) == {THEIRS}


def test_of_two_that_began_shortly_before_the_one_that_sent_fewer_commands_gives_way(
    probe: Probe,
) -> None:
    commands = probe.listen('command')
    node = probe.add(ControllerNode(parameters=CONTROL))
    probe.wait_until(lambda: len(commands) > 20)
    command = probe.publisher('command')
    probe.node.create_timer(0.2, lambda: command(THEIRS))
    told = f'{probe.namespace}/probe commands on {probe.namespace}/command too'
    probe.wait_until(lambda: probe.said() and told in probe.said()[-1][1])
    assert node.controller.enabled


def test_one_that_is_in_control_stays_so_and_both_are_told(
    probe: Probe, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rivals, 'PROBATION', 0.0)
    events: list[str] = []
    texts: list[str] = []

    def note(_: str, kind: str, text: str, __: Any) -> None:
        events.append(kind)
        texts.append(text)

    receive_events(probe.node, 'controller', note)
    node = probe.add(ControllerNode(parameters=CONTROL))
    probe.add(PlantNode(parameters=PLANT))
    probe.wait_until(lambda: node.controller.mode == Mode.OK)
    timer = rival(probe)
    told = f'{probe.namespace}/probe commands on {probe.namespace}/command too'
    probe.wait_until(lambda: told in probe.said()[-1][1] and probe.said()[-1][0] == ERROR)
    assert node.controller.mode == Mode.OK and node.controller.enabled
    assert [kind for kind in events if kind == 'rival'] == ['rival']
    timer.cancel()
    probe.wait_until(lambda: 'too' not in probe.said()[-1][1])
    settled = f'one alone commands on {probe.namespace}/command again'
    probe.wait_until(lambda: events[-1] == 'rival' and told in texts[-2] and texts[-1] == settled)
    assert settled in capfd.readouterr().err


def test_a_standby_takes_over_when_the_other_is_disabled_and_nobody_complains(
    probe: Probe,
) -> None:
    probe.add(PlantNode(parameters=PLANT))
    first = probe.add(ControllerNode(parameters=CONTROL))
    standby = CONTROL | {'enabled_at_start': False}
    second = probe.add(ControllerNode(parameters=standby, node_name='standby'))
    probe.wait_until(lambda: first.controller.mode == Mode.OK)
    for active, other in ((first, second), (second, first), (first, second)):
        assert active.enable()[0]
        probe.wait_until(lambda: other._rivals.commanding)  # noqa: B023
        probe.spin(0.3)  # what is subscribed and destroyed in each turn
        refused, why = other.enable()
        assert not refused and f'{active.get_fully_qualified_name()} commands on' in why
        assert active.enable(False)[0]
        probe.wait_until(lambda: not other._rivals.commanding)  # noqa: B023
    levels = {level for name in ('controller', 'standby') for level, _, _ in probe.said(name)}
    assert ERROR not in levels


def test_one_that_shares_the_command_on_purpose_begins_at_once(probe: Probe) -> None:
    commands, timer = probe.listen('command'), rival(probe)
    probe.wait_until(lambda: len(commands) > 2)
    node = probe.add(ControllerNode(parameters=CONTROL | {'share_command': True}))
    probe.wait_until(lambda: 1.5 in commands)
    assert node.controller.enabled
    timer.cancel()


def test_one_that_was_killed_is_no_rival_though_the_graph_knows_it_still(
    probe: Probe, start: Processes
) -> None:
    probe.add(PlantNode(parameters=PLANT | {'command_timeout': 0.5}))
    killed = start('controller', **CONTROL)
    probe.wait_until(lambda: probe.said() and probe.said()[-1][2]['mode'] == 'ok')
    killed.signal(signal.SIGKILL)
    killed.end()
    again = start('controller', '-r', '__node:=again', **CONTROL)
    probe.wait_until(lambda: probe.said('again') and probe.said('again')[-1][2]['mode'] == 'ok')
    assert 'commands on' not in again.said
    assert probe.said('again')[-1][0] == OK


def test_a_slow_loop_hears_a_rival_that_commands_as_seldom(
    probe: Probe, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, seconds in {'LISTEN': 0.02, 'PROBATION': 0.1, 'LONGEST': 0.1}.items():
        monkeypatch.setattr(rivals, name, seconds)  # as 0.3 s are for a period of 3 s
    commands, timer = probe.listen('command'), rival(probe, 0.2)
    probe.wait_until(lambda: len(commands) > 1)
    slow = {'rate': 5.0, 'inner_bandwidth': 1.0, 'outer_bandwidth': 1.0}
    slow |= {'controller_bandwidth': 0.5, 'measurement_timeout': 5.0, 'max_dt': 5.0}
    node = probe.add(ControllerNode(parameters=CONTROL | slow))
    probe.wait_until(lambda: not node.controller.enabled)
    n = len(commands)
    while len(commands) < n + 4:
        probe.spin(0.01)
        assert not node.enable()[0]
    assert set(commands) == {THEIRS}
    timer.cancel()
    probe.wait_until(lambda: node.enable()[0])


def test_who_is_disabled_and_never_sent_a_command_is_silent_and_not_at_safe(
    probe: Probe, capfd: pytest.CaptureFixture[str]
) -> None:
    commands = probe.listen('command')
    probe.add(ControllerNode(parameters=CONTROL | {'enabled_at_start': False}))
    probe.wait_until(lambda: probe.said() and probe.said()[-1][1].startswith('silent: disabled'))
    assert probe.enable().success
    probe.wait_until(lambda: 1.5 in commands)
    assert probe.enable(False).success
    at_safe = 'at the safe command: disabled'
    probe.wait_until(lambda: probe.said()[-1][1].startswith(at_safe))
    log = capfd.readouterr().err
    assert log.count('silent: disabled') == 1 and log.count(at_safe) == 1


def test_one_of_the_same_name_is_told_and_nobody_takes_the_loop_for_disabled(
    probe: Probe, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(graph, 'LISTED', 3.0)
    probe.add(PlantNode(parameters=PLANT))
    first = probe.add(ControllerNode(parameters=CONTROL))
    probe.wait_until(lambda: first.controller.mode == Mode.OK)
    second = ControllerNode(parameters=CONTROL)
    probe.executor.add_node(second)
    name = first.get_fully_qualified_name()
    told = f'another node is called {name} too'
    probe.wait_until(lambda: not second.controller.enabled and second._rivals.commanding)
    done, said = second.enable(False)
    topic = f'{probe.namespace}/command'
    assert not done
    assert said.startswith(f'already disabled, but another node called {name} commands on {topic}')
    assert f'another node called {name} commands on {topic}' in second.enable()[1]

    def levels() -> set[bytes]:
        remarks = [node.remarks._remarks.get('namesake') for node in (first, second)]
        return {remark.level if remark and remark.text else OK for remark in remarks}

    probe.wait_until(lambda: levels() == {WARN})
    probe.wait_until(lambda: levels() == {ERROR})
    assert f'{told}, unless it was killed' in capfd.readouterr().err
    probe.executor.remove_node(second)
    second.destroy_node()
    probe.wait_until(lambda: probe.said() and 'is called' not in probe.said()[-1][1])
    assert f'no other node is called {name} any more' in capfd.readouterr().err
    assert first.enable(False) == (True, 'disabled')


def test_stopped_before_its_first_command_it_sends_none(probe: Probe) -> None:
    commands = probe.listen('command')
    node = ControllerNode(parameters=CONTROL)
    assert node._rivals.listening
    node.begin_stop()
    assert node.stopped
    node.close()
    probe.spin(0.2)
    assert commands == []
    node.destroy_node()
