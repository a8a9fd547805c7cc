"""The parts of the live page's server that need neither ROS nor a network."""

from __future__ import annotations

import asyncio
import json
from math import nan
from pathlib import Path
import re

from nadrc_ros.cli.app import app
from nadrc_ros.live.access import Access
from nadrc_ros.live.blocks import DROPPED, pack, Ring, thin, unpack
from nadrc_ros.live.hold import Heartbeat, Hold, LEASE
from nadrc_ros.live.outbox import as_json, BLOCKS, Full, MESSAGES, Outbox
from nadrc_ros.live.undo import Undo
import numpy as np
import pytest
from typer.testing import CliRunner

ACCESS = Access(port=8700)
COOKIE = {'Cookie': f'a=b; {ACCESS.cookie_name}={ACCESS.cookie}'}


@pytest.mark.parametrize('host', ['127.0.0.1:8700', 'localhost:8700', '[::1]:8700'])
def test_p21_a_page_of_this_server_is_let_in(host: str) -> None:
    headers = {'Host': host, 'Origin': f'http://{host}', **COOKIE}
    assert not ACCESS.refusal(headers, socket=True)
    assert ACCESS.knows(headers)


@pytest.mark.parametrize(
    'headers',
    [
        {'Host': 'evil.example:8700'},
        {'Host': '127.0.0.1'},
        {'Host': '127.0.0.1:8701'},
        {'Host': '192.168.1.7:8700'},
        {'Host': ''},
        {},
        {'Host': '127.0.0.1:8700', 'Origin': 'http://evil.example'},
        {'Host': '127.0.0.1:8700', 'Origin': 'http://localhost:8700'},
        {'Host': '127.0.0.1:8700', 'Origin': 'https://127.0.0.1:8700'},
        {'Host': '127.0.0.1:8700', 'Origin': 'null'},
    ],
)
def test_p21_a_foreign_host_or_origin_is_refused(headers: dict[str, str]) -> None:
    assert ACCESS.refusal(headers)


def test_p21_a_websocket_says_where_it_is_from() -> None:
    headers = {'Host': '127.0.0.1:8700'}
    assert ACCESS.refusal(headers, socket=True) and not ACCESS.refusal(headers)


@pytest.mark.parametrize('cookie', ['', 'x', f'{ACCESS.cookie_name}=', 'nadrc_live_8700="a', ';='])
def test_p21_a_wrong_cookie_is_none(cookie: str) -> None:
    assert not ACCESS.knows({'Cookie': cookie})
    assert not ACCESS.admits('') and not ACCESS.admits('ü') and ACCESS.admits(ACCESS.token)


@pytest.mark.parametrize('host', ['0.0.0.0', '::', ''])
def test_p21_everywhere_means_addresses_and_no_names(host: str) -> None:
    access = Access(port=8700, host=host)
    assert '//:' not in access.address and access.refusal({'Host': ':8700'})
    assert not access.refusal({'Host': '192.168.1.7:8700'})
    assert access.refusal({'Host': 'rebound.example:8700'})


def test_p21_what_waited_in_a_queue_is_no_heartbeat() -> None:
    heartbeat = Heartbeat()
    assert all(heartbeat.is_fresh(k, 5.0 + 0.1 * k, 100.0 + 0.1 * k) for k in range(5))
    # the page stood still for 2 s, and sent what was due
    assert heartbeat.is_fresh(5, 7.5, 102.5)
    # the network stood still for 2 s, and what was sent meanwhile comes at once
    stale = [heartbeat.is_fresh(6 + k, 7.6 + 0.1 * k, 104.6) for k in range(20)]
    assert stale[:17] == [False] * 17 and stale[-1]
    assert not heartbeat.is_fresh(20, 9.6, 104.7), 'a number that was there'


class Loop:
    """Stands for a controller that takes leases, with a time of its own."""

    def __init__(self) -> None:
        self.time = 0.0
        self.leases: list[float] = []
        self.stops: int = 0
        self.hold = Hold(self.leases.append, self.stop, lambda: self.time)

    def stop(self) -> None:
        self.stops += 1

    def beat(self, number: int) -> None:
        self.hold.beat(number, 3.0 + self.time)


def test_p21_a_lease_that_ran_out_is_not_renewed() -> None:
    loop = Loop()
    loop.beat(1)
    assert loop.hold.beats and not loop.leases, 'a beat alone runs nothing'
    loop.hold.begin()
    loop.time = 0.1
    loop.beat(2)
    assert loop.leases == [LEASE, LEASE]
    loop.time = 0.1 + LEASE + 0.01
    loop.beat(3)
    assert loop.leases == [LEASE, LEASE] and not loop.hold.holding
    assert loop.stops == 1
    loop.time += 0.1
    loop.beat(4)
    assert loop.leases == [LEASE, LEASE] and loop.hold.left is None


def test_a_block_has_the_samples_as_float32_and_precise_times() -> None:
    rows = np.array([[1000.005, 1.1, nan], [1000.010, 2.2, -3.3]])
    sequence, flags, t0, found = unpack(pack(7, 5, rows))
    assert (sequence, flags, t0) == (7, 5, 1000.005)
    assert np.array_equal(found[:, 1:], rows[:, 1:].astype(np.float32), equal_nan=True)
    assert np.allclose(t0 + found[:, 0], rows[:, 0], atol=1e-9)


def test_thinned_rows_show_every_peak() -> None:
    rows = np.column_stack([np.arange(1000.0), np.zeros(1000), np.full(1000, nan)])
    rows[537, 1], rows[871, 1], rows[3, 2] = 9.0, -9.0, 4.0
    found = thin(rows, 50)
    assert found.shape == (100, 3) and (np.diff(found[:, 0]) >= 0.0).all()
    assert found[:, 1].max() == 9.0 and found[:, 1].min() == -9.0
    assert np.nanmax(found[:, 2]) == 4.0 and np.isnan(found[2:, 2]).all()
    assert thin(rows[:100], 50) is not None and len(thin(rows[:100], 50)) == 100


def test_a_ring_keeps_the_newest_rows() -> None:
    ring = Ring(2, seconds=10.0, most=50)
    for k in range(100):
        ring.add(np.array([[k, k], [k + 0.5, k]]))
    assert ring.last == 99.5
    assert list(ring.between(95.0, 96.0)[:, 0]) == [95.0, 95.5, 96.0]
    assert len(ring.between(0.0, 100.0)) <= 50 and not len(ring.between(0.0, 50.0))


def test_p22_a_slow_page_has_little_waiting_and_knows_what_it_missed() -> None:
    sent: list[str | bytes] = []
    gate = asyncio.Event()

    async def write(message: str | bytes) -> None:
        await gate.wait()
        sent.append(message)

    async def go() -> None:
        outbox = Outbox(write)
        running = asyncio.create_task(outbox.run())
        for k in range(10 * BLOCKS):
            outbox.add(np.array([[k, 1.0]]))
            outbox.tell({'type': 'state', 't': k})
            await asyncio.sleep(0)
        gate.set()
        while len(sent) < BLOCKS + 2:
            await asyncio.sleep(0)
        running.cancel()

    asyncio.run(go())
    states = [json.loads(m) for m in sent if isinstance(m, str)]
    blocks = [unpack(m) for m in sent if isinstance(m, bytes)]
    assert len(states) <= 2 and states[-1]['t'] == 10 * BLOCKS - 1
    assert [b[0] for b in blocks] == list(range(len(blocks)))
    assert [b[2] for b in blocks][-BLOCKS:] == list(range(9 * BLOCKS, 10 * BLOCKS))
    assert sum(bool(b[1] & DROPPED) for b in blocks) == 1


def test_p22_a_page_that_takes_no_messages_is_given_up() -> None:
    async def go() -> None:
        outbox = Outbox(asyncio.sleep)  # type: ignore[arg-type]
        for k in range(MESSAGES):
            outbox.tell({'type': 'event', 'k': k})
        with pytest.raises(Full):
            outbox.tell({'type': 'event'})

    asyncio.run(go())


def test_the_protocol_is_written_down() -> None:
    root = Path(__file__).parents[1]
    text = (root / 'docs' / 'live_protocol.md').read_text(encoding='utf-8')
    sources = sorted((root / 'nadrc_ros' / 'live').glob('*.py'))
    code = '\n'.join(path.read_text(encoding='utf-8') for path in sources)
    types = set(re.findall(r"'type': '(\w+)'", code))
    asked = set(re.findall(r"^ +'(\w+)': self\._\w+,$", code, re.MULTILINE)) | {'stop', 'beat'}
    assert len(types) == 9 and len(asked) == 14
    assert all(f'| `{name}` |' in text for name in types), types
    assert all(re.search(rf'^\| [^|]*`{name}`', text, re.MULTILINE) for name in asked), asked


def test_json_has_null_for_what_is_no_number() -> None:
    assert (
        as_json({'a': nan, 'b': [float('inf'), np.float64(2.0)]})
        == '{"a": null, "b": [null, 2.0]}'
    )


def test_changes_are_undone_one_by_one_and_all_at_once() -> None:
    undo, now = Undo(), {'a': 1.0, 'b': 2.0}
    undo.begin(now)
    undo.note({'a': 5.0}, now)
    now = {'a': 5.0, 'b': 2.0}
    undo.note({'a': 6.0, 'b': 7.0}, now)
    now = {'a': 6.0, 'b': 7.0}
    assert undo.previous() == {'a': 5.0, 'b': 2.0} and undo.since_start(now) == {
        'a': 1.0,
        'b': 2.0,
    }
    undo.drop()
    assert undo.previous() == {'a': 1.0}


def test_a_live_demo_is_no_lockstep() -> None:
    done = CliRunner().invoke(app, ['demo', '--live', '--lockstep'])
    assert done.exit_code == 2 and '--live' in done.output and 'not with --lockstep' in done.output


def test_without_bokeh_the_command_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('rclpy')
    monkeypatch.setattr('nadrc_ros.cli.live.find_spec', lambda name: None)
    done = CliRunner().invoke(app, ['live', '--port', '0'])
    assert done.exit_code == 1 and "pip install 'bokeh" in ' '.join(done.output.split())
