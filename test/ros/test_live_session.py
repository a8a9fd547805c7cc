"""What the pages of one loop share, without a browser, a server or a loop."""

from __future__ import annotations

import asyncio
from contextlib import closing
import json
from pathlib import Path
import socket
from typing import Any

from nadrc_ros.adrc.errors import UserError
from nadrc_ros.live.hello import Rate, state
from nadrc_ros.live.monitor import Monitor
from nadrc_ros.live.requests import Requests
from nadrc_ros.live.run import Asked, serve
from nadrc_ros.live.search import node_names, once
from nadrc_ros.live.session import Session
import numpy as np
from probe import Probe
import pytest
from std_msgs.msg import Float64
from std_srvs.srv import SetBool


def test_a_port_that_is_taken_is_named() -> None:
    with closing(socket.socket()) as taken:
        taken.bind(('127.0.0.1', 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(UserError, match=f'port {port}: Address already in use; --port 0'):
            serve(Asked(controller='/x', port=port), lambda address, name: None, print)


@pytest.mark.parametrize('name', ['x y', '/a//b', '/9', 'a/', '~/x', '/é'])
def test_what_is_no_name_of_a_node_is_refused(name: str) -> None:
    with pytest.raises(UserError, match='not the name of a node, such as /arm/controller'):
        node_names(name, '', print)


def test_who_waits_says_for_whom_and_who_is_there(probe: Probe) -> None:
    typed, meant = f'{probe.namespace}/contoller', f'{probe.namespace}/controller'
    monitor = Monitor(
        namespace=probe.namespace, node_name='watching', parameters={'controller': 'contoller'}
    )
    probe.add(monitor)
    probe.wait_until(lambda: monitor.absent.startswith(f'waiting for {typed}: no controller is'))
    asked = probe.node.create_service(SetBool, f'{meant}/enable', lambda request, answer: answer)
    told = probe.node.create_publisher(Float64, f'{meant}/output_estimate', 1)
    probe.wait_until(lambda: f'which is not there: did you mean {meant}?' in monitor.absent)
    assert state(monitor, Rate())['text'] == monitor.absent
    monitor._on_parameters(typed, {'b0': 1.0}, None)
    probe.wait_until(lambda: monitor.absent == '')
    assert probe.node.destroy_service(asked) and probe.node.destroy_publisher(told)


def test_a_wait_that_nobody_was_told_of_does_not_end_with_a_word() -> None:
    said: list[str] = []
    remark = once(said.append)
    for text in ('/x is there', 'waiting for /x', 'waiting for /x', '/x is there', '/x is there'):
        remark(text)
    assert said == ['waiting for /x', '/x is there']


def test_a_server_can_be_for_reading_only(probe: Probe, tmp_path: Path) -> None:
    settings = {'controller': 'controller', 'read_only': True}
    monitor = Monitor(namespace=probe.namespace, node_name='watching', parameters=settings)
    told: list[Any] = []

    async def write(message: str | bytes) -> None:
        told.append(json.loads(message))

    async def ask(*wanted: str) -> None:
        session = Session(monitor)
        requests = Requests(session, tmp_path)
        client = session.enter(write, lambda: None)
        for do in wanted:
            requests.take(client, json.dumps({'id': do, 'do': do, 'values': {'b0': 2.0}}))
        while sum(each['type'] == 'answer' for each in told) < len(wanted):
            await asyncio.sleep(0.01)
        session.close()

    changing = ('stop', 'apply', 'enable', 'back', 'take_over', 'pin', 'swap', 'guard', 'fault')
    asyncio.run(ask(*changing, 'report', 'save'))
    assert monitor.peer is None, 'nothing could change anything'
    monitor.destroy_node()
    assert told[0]['read_only'] and not told[0]['operator'] and not told[0]['faults']
    answers = {each['id']: each for each in told if each['type'] == 'answer'}
    assert all('--read-only' in answers[do]['text'] for do in (*changing, 'report'))
    assert '--read-only' not in answers['save']['text']


def test_a_controller_that_is_started_with_other_parameters_is_a_new_one(
    probe: Probe,
) -> None:
    monitor = Monitor(namespace=probe.namespace, node_name='live', parameters={})
    told: list[Any] = []

    async def write(message: str | bytes) -> None:
        told.append(json.loads(message))

    async def go() -> None:
        session = Session(monitor)
        session.enter(write, lambda: None)
        session.changes.undo.note({'b0': 3.0}, {'b0': 0.5})
        for b0, before in ((1.0, {'b0': 0.5}), (1.0, {'b0': 0.5}), (2.0, {})):
            monitor._on_parameters(monitor.controller, {'b0': b0, 'rate': 100.0}, None)
            await asyncio.sleep(0.05)
            assert session.changes.undo.previous() == before
        rows = np.arange(10.0 * (1 + len(monitor.signals))).reshape(10, -1)
        monitor.ring.add(rows)
        monitor._listen((*monitor.signals[:3], 'level_1', monitor.signals[3]))
        kept = monitor.ring.between(0.0, 100.0)
        assert np.array_equal(kept[:, [0, 1, 2, 3, 5]], rows[:, :5]) and np.isnan(kept[:, 4]).all()
        assert session.changes.undo.since_start({'b0': 3.0}) == {'b0': 2.0}
        session.close()

    asyncio.run(go())
    monitor.destroy_node()
    assert [each['kind'] for each in told if each['type'] == 'event'] == ['started']
