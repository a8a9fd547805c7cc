"""The server of the live page beside a running loop: who may do what, and how fast it stops."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from math import inf
from pathlib import Path
import signal
import socket
import time
from typing import NamedTuple

from live_loop import Page, PERIOD, quickest, RATE, Served, until
from nadrc_ros.live.blocks import Array, THINNED
from nadrc_ros.nodes.controller import ControllerNode
from nadrc_ros.parameter_file import parameters_in
from nadrc_ros.records.read_run import read_run
from nadrc_ros.records.recorded_run import RecordedRun, window
import numpy as np
from numpy.typing import NDArray
from probe import Probe, Processes
import pytest

# Promised of a stop, and of a heartbeat that ends [s].
STOP, LAPSE = 0.1 + PERIOD, 0.5 + PERIOD
NAMESPACE = '/live_loop'
# Rows that are compared one by one, and stretches of which one has to have all samples.
LAST, STRETCHES = 100, 3
SOCKET = {
    'Upgrade': 'websocket',
    'Connection': 'Upgrade',
    'Sec-WebSocket-Key': 'dGhlIHNhbXBsZSBub25jZQ==',
    'Sec-WebSocket-Version': '13',
}


@pytest.fixture(scope='module')
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Run one loop and one server for all tests of this module."""
    directory = tmp_path_factory.mktemp('live')
    probe, processes = Probe(NAMESPACE, directory), Processes(NAMESPACE, directory)
    loop = Served(probe, processes, directory)
    yield loop
    loop.close()
    processes.kill()
    probe.close()


@pytest.fixture
def page(served: Served) -> Iterator[Page]:
    """Open a page, which has control as the only one, once the last one is gone."""
    while not (page := Page(served.address)).hello['operator']:
        page.close()
    yield page
    if served.server.running:
        page.ask('stop')
    page.close()


def test_p21_without_token_or_from_elsewhere_nothing_is_told_or_changed(
    served: Served, page: Page
) -> None:
    served.enable()
    before = served.staged
    own = {'Cookie': page.cookie}
    for path in ('/', '/static/main.js', '/ws', '/nothing', '/?token=wrong', '/?do=stop'):
        assert page.get(path).status == 403, path
        assert page.get(path, Host='evil.example:80', **own).status == 403, path
        assert page.get(path, Origin='http://evil.example', **own).status == 403, path
    assert page.get('/', **own).status in (200, 404), 'the own page'
    for method in ('POST', 'PUT', 'DELETE', 'OPTIONS', 'HEAD'):
        assert page.get('/', method).status == 403
        assert page.get('/?do=stop', method, **own).status in (405, 200, 404), method
    upgraded = SOCKET | own
    assert page.get('/ws', **upgraded).status == 403, 'a socket without an Origin'
    assert page.get('/ws', Origin='http://evil.example', **upgraded).status == 403
    assert page.get('/ws', Origin=page.base, **SOCKET).status == 403, 'without a cookie'
    assert page.get('/ws', Origin=page.base, Host='localhost:1', **upgraded).status == 403
    assert page.get('/stop', **own).status == 404
    assert served.enabled
    assert served.staged == before


def test_headers_keep_everything_at_home(page: Page) -> None:
    headers = page.get('/', Cookie=page.cookie).headers
    policy = headers['Content-Security-Policy']
    assert "default-src 'none'" in policy and "script-src 'self';" in policy
    assert 'unsafe-eval' not in policy and headers['X-Content-Type-Options'] == 'nosniff'
    assert page.get('/static/../run.py', Cookie=page.cookie).status == 404
    assert page.get('/static/bokeh/bokeh.min.js', Cookie=page.cookie).status == 200
    given = page.get(f'/?token={page.token}').headers['Set-Cookie']
    assert 'HttpOnly' in given and 'SameSite=Strict' in given


def test_p21_garbage_kills_nothing(served: Served, page: Page) -> None:
    other = Page(served.address)
    rng = np.random.default_rng(3)
    shapes = ('{}', '[]', '"stop"', '{"do":', '{"do": 3}', '{"do": "apply"}', 'nan', '\u0000')
    for k in range(10_000):
        other.send(shapes[k % 8] if k % 2 else rng.bytes(20))
    other.send('[' * 60_000)
    other.send('{"do": "apply", "values": {"b0": ' + '9' * 5000 + '}, "id": {}}')
    other.send(rng.bytes(10_000_000))
    until(lambda: other.closed)
    count = len(page.blocks)
    until(lambda: len(page.blocks) > count + 5)
    assert served.server.running and 'Traceback' not in served.server.said
    assert page.ask('predict', values={})['ok'] and not served.enabled


def test_three_changes_are_one_event_and_come_back(served: Served, page: Page) -> None:
    settings = served.staged
    before = {n: getattr(settings, n) for n in ('controller_bandwidth', 'b0', 'inner_bandwidth')}
    served.told.clear()
    after = {'controller_bandwidth': 9, 'b0': 1.5, 'inner_bandwidth': 50.0}
    assert page.ask('apply', values=after)['ok']
    until(lambda: served.told)
    changed = until(lambda: page.of('parameters'))
    assert changed[0]['values'] == after and changed[0]['source'] == 'page'
    assert page.ask('back')['ok']
    until(lambda: len(page.of('parameters')) == 2)
    assert page.of('parameters')[1]['values'] == before
    assert [len(told) for told in served.told] == [3, 3]
    settings = served.staged
    assert {name: getattr(settings, name) for name in before} == before
    assert not page.ask('back')['ok']


def test_a_refused_value_has_the_reason_of_the_node(served: Served, page: Page) -> None:
    assert page.ask('enable', hold=False)['ok']
    refused = page.ask('apply', values={'b0': -1.0, 'inner_bandwidth': 45.0})
    assert not refused['ok'] and refused['refused'] == 'b0' and 'b0' in refused['text']
    assert (served.staged.b0, served.staged.inner_bandwidth) == (1.0, 40.0)
    wrong: tuple[object, ...] = ({}, [], {'b0': {}}, {'b0': None}, {'nothing': 1.0}, {'b0': 'x'})
    for values in wrong:
        assert not page.ask('apply', values=values)['ok'], values


def test_the_saved_file_makes_the_same_controller(
    served: Served, page: Page, tmp_path: Path
) -> None:
    assert page.ask('apply', values={'inner_bandwidth': 33.5, 'b0': 1.25})['ok']
    until(lambda: page.of('parameters'))
    saved = page.ask('save')
    assert [each['name'] for each in saved['difference']] == ['b0', 'inner_bandwidth']
    file = tmp_path / saved['name']
    file.write_text(saved['yaml'], encoding='utf-8')
    values = parameters_in(str(file))['/**/controller']
    copy = ControllerNode(namespace='/copy', parameters=values)
    for name, value in values.items():
        now = [node.get_parameter(name).value for node in (copy, served.controller)]
        assert now[0] == now[1] and (now[0] == value or list(now[0]) == value), name
    copy.destroy_node()
    assert page.ask('back', to='start')['ok'] and served.staged.b0 == 1.0


def test_faults_come_and_go_and_a_gap_is_told(served: Served, page: Page) -> None:
    assert page.ask('enable', hold=False)['ok']
    assert {each['name'] for each in page.hello['faults']} >= {'silent', 'gain', 'disturbance'}
    until(lambda: page.blocks)
    assert page.ask('fault', name='silent', on=True)['ok']
    measured = 1 + [each['name'] for each in page.hello['signals']].index('measurement')
    until(lambda: np.isnan(page.blocks[-1][2][-1, measured]))
    until(lambda: any(f['on'] for f in page.of('hello')[-1]['faults']))
    until(lambda: page.of('state')[-1]['cause'] == 'measurement_timeout')
    assert page.ask('fault', name='silent', on=False)['ok']
    gap = until(lambda: [e for e in page.of('event') if e.get('signal') == 'measurement'])[-1]
    assert gap['kind'] == 'gap' and gap['to'] - gap['from'] > 0.05
    assert not page.ask('fault', name='heat', on=True)['ok']


def test_a_loop_that_gets_worse_goes_back_to_what_was_pinned(served: Served, page: Page) -> None:
    assert not page.ask('swap')['ok'] and not page.ask('guard', on=True)['ok']
    assert page.ask('enable', hold=False)['ok']
    until(lambda: page.of('state')[-1]['mode'] == 'ok')
    begin = page.of('state')[-1]['t'] + 2.0
    until(lambda: page.blocks and page.blocks[-1][2][-1, 0] > begin + 1.0)
    assert page.ask('pin', **{'from': begin, 'to': begin + 1.0})['ok']
    for values in ({'outer_bandwidth': 28.0}, {'b0': 1.1}):
        assert page.ask('apply', values=values)['ok']
    assert page.ask('swap')['ok'] and served.staged.b0 == 1.0
    assert page.ask('swap')['ok'] and served.staged.b0 == 1.1
    assert page.ask('guard', on=True)['ok']
    assert page.ask('fault', name='gain', on=True, value=0.01)['ok']
    why = until(lambda: [e for e in page.of('event') if e['kind'] == 'guard'])[0]['text']
    assert why.endswith('back to the pinned parameters')
    running = served.controller.controller
    until(lambda: (running.settings.b0, running.settings.outer_bandwidth) == (1.0, 30.0))
    until(lambda: not page.of('guard')[-1]['on'])
    assert page.ask('fault', name='gain', on=False)['ok']
    assert page.ask('unpin')['ok']


def test_p22_stop_acts_at_once_whatever_else_is_asked_for(served: Served, page: Page) -> None:
    def stop() -> float:
        served.enable()
        begin = time.monotonic()
        until(lambda: served.commands and served.commands[-1][0] > begin + 0.05)
        for k in range(40):
            page.tell('predict', values={'b0': 1.0 + 0.01 * k})
            page.tell('save')
        begin = time.monotonic()
        page.tell('stop')
        return served.safe_since(begin)

    assert quickest(stop, STOP) <= STOP
    assert not served.enabled


def test_p22_a_page_that_watches_can_stop_but_nothing_else(served: Served, page: Page) -> None:
    watcher = Page(served.address)
    assert page.hello['operator'] and not watcher.hello['operator']
    assert not watcher.ask('enable', hold=False)['ok'] and not served.enabled
    assert 'take over' in watcher.ask('apply', values={'b0': 2.0})['text']
    assert page.ask('enable', hold=False)['ok'] and served.enabled
    assert watcher.ask('stop')['ok'] and not served.enabled
    assert watcher.ask('take_over')['ok']
    until(lambda: page.of('operator') and not page.of('operator')[-1]['operator'])
    assert not page.ask('back')['ok'] and watcher.ask('enable', hold=False)['ok']
    watcher.close()
    assert served.enabled, 'it was not held'
    page.ask('take_over')


def test_p21_a_heartbeat_that_stops_disables(served: Served, page: Page) -> None:
    assert 'heartbeat' in page.ask('enable', hold=True)['text'] and not served.enabled

    def freeze() -> float:
        with page.beating() as over:
            assert page.ask('enable', hold=True)['ok']
            time.sleep(1.0)
            if not served.enabled:  # on a busy machine a beat may be late: as long as none is
                return inf
            over.set()
            begin = time.monotonic()
            until(lambda: not served.enabled)
            return time.monotonic() - begin

    assert quickest(freeze, LAPSE) <= LAPSE
    with page.beating():
        time.sleep(0.5)
        assert not served.enabled, 'a beat alone enables nothing'


def test_p21_a_page_that_is_closed_lets_go(served: Served, page: Page) -> None:
    def close() -> float:
        other = Page(served.address)
        other.ask('take_over')
        with other.beating():
            assert other.ask('enable', hold=True)['ok'] and served.enabled
            begin = time.monotonic()
            other.close()
            until(lambda: not served.enabled)
            return time.monotonic() - begin

    assert quickest(close, LAPSE) <= LAPSE
    again = Page(served.address)
    with again.beating():
        time.sleep(0.3)
    assert not served.enabled, 'a page that is opened again enables nothing'
    again.close()


def test_no_row_comes_twice_or_out_of_order(served: Served, page: Page) -> None:
    begin = until(lambda: page.blocks)[-1][2][-1, 0]
    until(lambda: page.blocks[-1][2][-1, 0] > begin + 2.0)
    assert (np.diff(np.vstack([rows for *_, rows in page.blocks])[:, 0]) > 0.0).all()
    assert [block[0] for block in page.blocks] == list(range(len(page.blocks)))


class Stretch(NamedTuple):
    """The last rows of a page by name, the recorder's from ``place`` on, and figures of both."""

    time: Array
    shown: dict[str, NDArray[np.float32]]
    run: RecordedRun
    place: int
    figures: dict[str, float | None]
    part: RecordedRun


def stretch(served: Served, page: Page) -> Stretch | None:
    """Return three seconds of page and recorder, None if the page has not all of them."""
    begin = page.of('state')[-1]['t']
    until(lambda: page.blocks and page.blocks[-1][2][-1, 0] > begin + 4.0)
    blocks = [rows for _, flags, rows in page.blocks if not flags & THINNED]
    times = np.concatenate([rows[:, 0] for rows in blocks])
    first = int(np.searchsorted(times, begin + 1.0))
    # no row lies at either end
    start, end = (float(times[k - 1 : k + 1].mean()) for k in (first, len(times) - 1))
    told = len(page.of('comparison'))
    pinned = page.ask('pin', **{'from': start, 'to': end})
    assert pinned['ok'], pinned
    names = [each['name'] for each in page.hello['signals']]
    # one that was found later has a column from then on
    own = [rows[rows[:, 0] <= end] for rows in blocks if rows.shape[1] == 1 + len(names)]
    if sum(map(len, own)) < LAST:
        return None
    rows = np.vstack(own)[-LAST:]
    shown = {name: rows[:, 1 + i].astype(np.float32) for i, name in enumerate(names)}

    def recorded() -> tuple[RecordedRun, int] | None:
        run = read_run(Path(served.recorder._save()))
        column = run.columns['measurement'].astype(np.float32)
        places = np.flatnonzero(column == shown['measurement'][0])
        return (run, int(places[0])) if places.size and run.time.size - places[0] > 200 else None

    run, place = until(recorded)
    offset = rows[0, 0] - run.time[place]
    part = window(run, start - offset, end - offset)
    if np.count_nonzero((times >= start) & (times <= end)) != part.time.size:
        return None
    until(lambda: len(page.of('comparison')) > told)
    figures = page.of('comparison')[-1]['before']['figures']
    return Stretch(rows[:, 0] - offset, shown, run, place, figures, part)


# Nobody waits for a page: where its server stands still for long, samples do not reach it.
@pytest.mark.realtime
def test_rows_are_those_of_the_recorder_and_figures_those_of_its_report(
    served: Served, page: Page
) -> None:
    served.recorder._reset()
    assert page.ask('enable', hold=False)['ok']
    found = next(filter(None, (stretch(served, page) for _ in range(STRETCHES))), None)
    assert found is not None, 'in no stretch all samples reached the page'
    same = slice(found.place, found.place + LAST)
    for name, shown in found.shown.items():
        column = found.run.columns.get(name)
        if column is not None:
            assert np.array_equal(shown, column[same].astype(np.float32)), name
    assert np.allclose(found.time, found.run.time[same], atol=1e-4)
    for name, value in found.part.metrics.as_dict().items():
        near = value if value is None else pytest.approx(value, rel=1e-4)
        assert found.figures[name] == near, name


def test_ctrl_c_stops_what_is_held_and_ends(served: Served, page: Page) -> None:
    process, address = served.serve()
    other = Page(address)
    with other.beating():
        assert other.ask('enable', hold=True)['ok'] and served.enabled
        process.signal(signal.SIGINT)
        assert process.end() == 0
    until(lambda: not served.enabled)
    assert process.own_lines[-1] == 'note: stopped'


def test_p22_a_page_that_never_reads_costs_nothing(served: Served, page: Page) -> None:
    assert page.ask('enable', hold=False)['ok']
    missed, count = served.controller.ticker.missed, len(served.commands)
    begin = time.monotonic()
    name, _, port = page.host.partition(':')
    with closing(socket.socket()) as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        deaf.connect((name, int(port)))
        headers = {'Host': page.host, 'Origin': page.base, 'Cookie': page.cookie} | SOCKET
        lines = ['GET /ws HTTP/1.1', *(f'{name}: {value}' for name, value in headers.items())]
        deaf.sendall('\r\n'.join([*lines, '', '']).encode())
        until(lambda: page.of('state')[-1]['clients'] == 2)
        until(lambda: page.of('state')[-1]['clients'] == 1)  # it was given up
    periods = RATE * (time.monotonic() - begin)
    assert len(page.blocks) > 20
    assert [block[0] for block in page.blocks] == list(range(len(page.blocks)))
    sent = len(served.commands) - count + served.controller.ticker.missed - missed
    assert sent >= 0.8 * periods and served.server.running


def test_p22_a_server_that_stands_still_or_is_killed_costs_the_controller_nothing(
    served: Served, page: Page
) -> None:
    process = served.server
    with page.beating():
        assert page.ask('enable', hold=False)['ok']
        missed = served.controller.ticker.missed
        count, begin = len(served.commands), time.monotonic()
        process.signal(signal.SIGSTOP)
        time.sleep(1.0)
        periods = RATE * (time.monotonic() - begin)
        sent = len(served.commands) - count
        process.signal(signal.SIGCONT)
        assert sent + served.controller.ticker.missed - missed >= 0.8 * periods
        assert page.ask('enable', hold=True)['ok']
        begin = process.signal(signal.SIGKILL)
        until(lambda: not served.enabled)
        taken = time.monotonic() - begin
    assert process.end() == -signal.SIGKILL
    assert taken <= LAPSE
