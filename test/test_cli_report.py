"""`nadrc report` on what runs leave: whole, poor, broken and hostile."""

from __future__ import annotations

import json
from math import nan
from pathlib import Path
import re
import sys
from typing import Any

from bag_helpers import write_bag
from bokeh.models.annotations import BoxAnnotation
from bokeh.models.sources import ColumnDataSource
from nadrc_ros.cli.app import app
from nadrc_ros.records.history import ABOUT, append_event, append_parameters, Event, PARAMETERS
from nadrc_ros.records.recording import (
    read_samples,
    RunSettings,
    SAMPLES,
    SETTINGS,
    STAMPS,
    SUMMARY,
)
from nadrc_ros.report import page as page_module
from nadrc_ros.report.roles import STATES
from nadrc_ros.report.tables import shown_together
import numpy as np
from page_helpers import Page, unpacked
import pytest
from report_helpers import describe, NOTHING, record, SIGNALS
from typer.testing import CliRunner

ORDER = 'figures happened plots disturbance spectrum timing parameters origin'
HOSTILE = '</script><script>alert(1)</script><img src=x onerror=alert(2)>"\'&'


def nadrc(*arguments: object) -> Any:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def report(*runs: Path, **options: Any) -> Page:
    out = runs[0].parent / 'page.html'
    named = [text for key, value in options.items() for text in (f'--{key}', value)]
    done = nadrc('report', *runs, '--page', out, *named)
    assert done.exit_code == 0, done.output
    return Page(out.read_text(encoding='utf-8'))


def test_a_page_has_the_figures_to_the_digits_and_every_section(tmp_path: Path) -> None:
    run = record(tmp_path)
    describe(run, '/mine', b0=2.0)
    append_parameters(run, 1.5, '/mine/controller', {'inner_bandwidth': 55.5})
    page = report(run)
    metrics = json.loads((run / SUMMARY).read_text())['metrics']
    for name in ('itae', 'isu', 'iae', 'rmse', 'max_error', 'max_command'):
        (text,) = shown_together(name, [metrics[name]])
        assert f'title="{metrics[name]!r}">{text}<' in page.source, name
        assert float(text) == pytest.approx(metrics[name], rel=1e-3)
    sections = [attrs['id'] for tag, attrs in page.tags if tag == 'h2']
    links = [(attrs['href'] or '')[1:] for tag, attrs in page.tags if tag == 'a']
    assert sections == links == ORDER.split()
    assert '4 s at 100 Hz on the plant paper, started then.' in page.words()
    assert 'Nothing was lost. One parameter was changed during the run.' in page.words()
    assert 'All parameters are printed only if they are open' in page.words()
    for text in ('inner_bandwidth', '55.5', str(2**63 - 1)):
        assert text in page.text
    assert 'Bandwidths: A controller at 4 rad/s; B level 2 at 30 rad/s;' in page.words()
    assert 'level 1 at 55.5 rad/s from 1.5 s' in page.words()
    for name in ('reference', 'output', 'measurement', 'error', 'command', 'truth', 'estimate'):
        assert len(page.lines(name)) == 1, name
    assert page.data['timed'] == [True] * 5 + [False] * 3
    assert page.labels().count(('1', 1.5)) == 5
    assert page.data['span'] == [0.0, 3.99]
    captions = [attrs for tag, attrs in page.tags if attrs.get('role') == 'img']
    assert len(captions) == page.text.count('time from') + 6 == 8
    assert all(each['aria-label'] for each in captions)


def test_what_acted_and_the_feed_forward_are_shown_with_the_command(tmp_path: Path) -> None:
    signals = (*SIGNALS, 'applied', 'feed_forward', *STAMPS)
    page = report(record(tmp_path / 'a', signals, applied=1.5, feed_forward=-0.5))
    for name, dash, value in (('applied', [2, 4], 1.5), ('feed_forward', [6], -0.5)):
        (line,) = page.lines(name)
        assert line.tags == [0, name, True] and line.glyph.line_dash == dash
        assert set(page.column(name)) == {value}
    assert 'Dotted: what acted, as reported. Dashed: the feed-forward in it.' in page.words()
    page = report(record(tmp_path / 'b', (*SIGNALS, 'applied', *STAMPS), applied=nan))
    assert not page.lines('applied') and 'Dotted: what acted' not in page.words()


def test_every_sample_is_in_the_page_in_single_precision(tmp_path: Path) -> None:
    run = record(tmp_path)
    page = report(run)
    samples = {name: np.array(column) for name, column in read_samples(run).items()}
    samples['error'] = samples['reference'] - samples['output']
    samples['miss'] = samples['disturbance_estimate'] - samples['total_disturbance']
    for name in ('reference', 'output', 'measurement', 'command', 'error', 'miss'):
        np.testing.assert_array_equal(page.column(name), samples[name].astype(np.float32))
    np.testing.assert_array_equal(page.column('time'), samples['time'])


def test_a_small_motion_far_from_zero_is_in_the_page_in_double_precision(tmp_path: Path) -> None:
    page = report(record(tmp_path, output=1e5 + 1e-3, reference=1e5, command=1e100))
    assert set(page.column('output')) == {1e5 + 1e-3} and set(page.column('command')) == {1e100}
    assert page.column('error')[0] == pytest.approx(-1e-3, rel=1e-6)


def test_a_page_loads_nothing_and_is_not_large(tmp_path: Path) -> None:
    page = report(record(tmp_path, count=3000))
    for tag, attrs in page.tags:
        assert tag not in ('link', 'iframe', 'object', 'img') or attrs.get('href') == 'data:,'
        for name in ('src', 'srcset', 'href', 'action', 'poster', 'data'):
            assert (attrs.get(name) or '#').startswith(('#', 'data:')), (tag, attrs)
    own = re.sub(r'<script>.*?</script>', '', page.source, flags=re.DOTALL)
    assert not re.search(r'https?:|@import|url\(', own)
    assert len(page.source) < 0.8e6
    assert (
        unpacked(page.source, 'bokeh').count(b'* Copyright (c) Anaconda') == 1
    )  # the library, once


def test_a_long_run_is_thinned_to_its_peaks_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = record(tmp_path, count=12_500)
    lines = (run / SAMPLES).read_text().splitlines(keepends=True)
    peak = lines[9_346].split(',')
    lines[9_346] = ','.join([*peak[:3], '123.25', *peak[4:]])
    (run / SAMPLES).write_text(''.join(lines))
    whole = report(run)
    assert len(whole.column('time')) == 12_500 and 'is thinned' not in whole.text
    monkeypatch.setattr(page_module, 'MOST_ROWS', 5_000)
    page = report(run)
    times, commands = page.column('time'), page.column('command')
    assert len(times) == len(commands) <= 5_000
    assert times[commands.argmax()] == 93.45 and commands.max() == 123.25
    assert re.search(r'is thinned: .* value of every \d+ rows are here', page.words())


def test_lines_break_in_a_gap_that_is_shaded_with_its_cause(tmp_path: Path) -> None:
    run = record(tmp_path)
    settings = json.loads((run / SETTINGS).read_text())
    (run / SETTINGS).write_text(json.dumps(settings | {'rate': 0.0}))
    lines = (run / SAMPLES).read_text().splitlines(keepends=True)
    (run / SAMPLES).write_text(''.join(lines[:101] + lines[301:]))
    append_event(run, Event(1.0, '/recorder', 'gap', 'no measurement for 2.01 s: nothing <sent>'))
    append_event(run, Event(0.99, '/plant', 'fault', 'measurement silent'))
    page = report(run)
    time, output = page.column('time'), page.column('output')
    assert len(time) == 201
    assert np.isnan(output[100]) and 0.99 < time[100] < 1.1
    assert np.isfinite(np.delete(output, 100)).all()
    ((begin, end, cause),) = page.data['runs'][0]['gaps']
    assert (begin, end) == (0.99, 3.0)
    assert cause == 'no measurement for 2.01 s: nothing <sent>, fault "measurement silent"'
    bands = [each for each in page.models if isinstance(each, BoxAnnotation)]
    assert [(band.left, band.right) for band in bands] == [(0.99, 3.0)] * 5


def test_what_the_controller_did_is_a_strip_and_behind_the_lines(tmp_path: Path) -> None:
    runs = [record(tmp_path / name, seed=seed) for seed, name in enumerate('ab')]
    for run, name in zip(runs, 'ab'):
        describe(run, f'/{name}')
        for time, text in (
            (None, 'in control'),
            (1.0, 'holding: no valid measurement'),
            (1.5, 'going to the safe command: no valid measurement'),
            (2.0, 'in control'),
        ):
            append_event(run, Event(time, f'/{name}/controller', 'mode', text))

    def behind(page: Page) -> list[tuple[Any, ...]]:
        bands = (each for each in page.models if isinstance(each, BoxAnnotation))
        return sorted((band.left, band.right, band.fill_color) for band in bands)

    held, ramped = (1.0, 1.5, STATES['holding']), (1.5, 2.0, STATES['ramping'])
    alone = report(runs[0])
    assert alone.data['timed'] == [True] * 6 + [False] * 3
    assert behind(alone) == [held] * 5 + [ramped] * 5
    sources = [each.data for each in alone.models if isinstance(each, ColumnDataSource)]
    spans = [
        (a, b) for each in sources if 'left' in each for a, b in zip(each['left'], each['right'])
    ]
    assert sorted(spans) == [(0.0, 1.0), (1.0, 1.5), (1.5, 2.0), (2.0, 3.99)]
    cells = re.sub('</?td>', ' ', alone.source)
    assert ' 0.000  1.000  controller  in control ' in cells
    assert ' 1.000  0.500  controller  holding: no valid measurement ' in cells
    both = report(*runs)
    assert behind(both) == [held] * 2 + [ramped] * 2  # behind the disturbance of each run
    assert [len(run['states']) for run in both.data['runs']] == [2, 2]


@pytest.mark.parametrize('where', ['folder', 'namespace', 'parameter', 'about', 'summary'])
def test_hostile_names_are_only_text(where: str, tmp_path: Path) -> None:
    plain = HOSTILE.replace('/', '∕')
    run = record(tmp_path / (plain if where == 'folder' else 'runs'))
    describe(run, '/' + (plain if where == 'namespace' else 'mine'), b0=2.0)
    if where == 'folder':
        (run / ABOUT).unlink()
        run = run.rename(run.parent / plain)
    if where == 'parameter':
        append_parameters(run, None, f'/mine/{HOSTILE}', {HOSTILE: HOSTILE, 'plant': HOSTILE})
        append_parameters(run, 1.0, f'/mine/{HOSTILE}', {HOSTILE: [HOSTILE, {HOSTILE: 1}]})
    if where == 'about':
        content = {'started': HOSTILE, 'namespace': [HOSTILE], 'versions': {HOSTILE: HOSTILE}}
        (run / ABOUT).write_text(json.dumps(content))
    if where == 'summary':
        lost = {'samples_lost': 3, 'samples_lost_by_signal': {HOSTILE: HOSTILE}}
        (run / SUMMARY).write_text(json.dumps(lost))
    other = record(tmp_path / 'other', seed=2)
    describe(other, '/other')
    for page in (report(run), report(run, other)):
        scripts = [attrs for tag, attrs in page.tags if tag == 'script']
        assert len(scripts) == 5
        assert not any(tag == 'img' for tag, _ in page.tags)
        assert not any(name.startswith('on') for _, attrs in page.tags for name in attrs)
        assert 'alert(1)' in page.text


def test_hostile_files_are_named_in_one_line(tmp_path: Path) -> None:
    run = record(tmp_path)
    for name, content in (
        (ABOUT, '[]'),
        (ABOUT, '{'),
        (PARAMETERS, '{"time": 1, "node": 2, "values": {}}\n'),
        (PARAMETERS, '{"time": NaN, "node": "a", "values": {}}\n'),
        (PARAMETERS, '{"time": 1, "node": "a", "values": []}\n'),
        (PARAMETERS, '7\n'),
    ):
        (run / name).write_text(content)
        done = nadrc('report', run)
        assert done.exit_code == 1
        assert done.output.startswith(f'error: {run}: {name}')
        assert done.output.count('\n') == 1
        assert not (run / 'report.html').exists()
        (run / name).unlink()


def test_a_line_that_was_cut_short_is_left_out(tmp_path: Path) -> None:
    run = record(tmp_path)
    describe(run, '/mine')
    with (run / PARAMETERS).open('a') as file:
        file.write('{"time": 1.0, "node": "/mine/contr')
    assert 'What happened' not in report(run).text


def test_a_run_without_truth_stamps_or_parameters_says_so(tmp_path: Path) -> None:
    page = report(record(tmp_path, columns=SIGNALS[:3], summary=False))
    for text in (
        'Neither an estimate of the disturbance nor its true value was recorded.',
        'Nothing here tells when samples left their publishers',
        'The parameters of the nodes were not recorded.',
        'was not ended by the recorder',
    ):
        assert text in page.text
    assert page.data['timed'] == [True] * 3 + [False]


@pytest.mark.parametrize(
    'options',
    [{'count': 1}, {'count': 2}, NOTHING, {'command': nan}, {'reference': nan, **NOTHING}],
    ids=['one row', 'two rows', 'no truth', 'no command', 'no error'],
)
def test_poor_runs_have_a_page_and_a_picture(options: dict[str, Any], tmp_path: Path) -> None:
    run = record(tmp_path, **options)
    page = report(run)
    assert not re.search(r'\b(nan|inf)\b', page.text)
    assert nadrc('report', run, '--plot', tmp_path / 'a.png').exit_code == 0


def test_runs_of_different_length_and_rate_are_compared(tmp_path: Path) -> None:
    fast = RunSettings(rate=250.0)
    first, second = record(tmp_path / 'a'), record(tmp_path / 'b', run=fast, seed=2)
    describe(first, '/one', structure='conventional', outer_bandwidth=20.0)
    describe(second, '/two', outer_bandwidth=20.0)
    for run, time, value in ((first, 1.0, 9.5), (second, 1.05, 9.5), (second, 1.5, 7.5)):
        node = '/one/controller' if run == first else '/two/controller'
        append_parameters(run, time, node, {'outer_bandwidth': value})
    page = report(first, second)
    assert 'one and two compared' in page.text
    assert '2 runs of different length or rate on the plant paper.' in page.words()
    assert 'One parameter was changed during the run.' in page.words()  # thrice
    assert 'Their integrals cover different times. Lowest RMSE: ' in page.words()
    assert [len(page.lines(name)) for name in ('output', 'measurement', 'miss')] == [2, 2, 2]
    assert '<b><span' not in page.source  # no winner: integrals grow with the length
    assert re.search('Those in which the runs differ.*structure', page.text, re.DOTALL)
    marks = {text for text, _ in page.labels()}
    assert {'1', '2'} <= marks and '3' not in marks
    assert page.source.count('<td>one, two</td>') == 1
    assert '<td>20 <span class="meaning">ignored</span></td>' in page.source


def test_a_bag_is_reported_like_a_folder(tmp_path: Path) -> None:
    times = [0.01 * k for k in range(300)]
    loop = {
        f'/arm/{topic}': [(t + late, 1.0 / (1.0 + t)) for t in times]
        for topic, late in (('reference', 0.0), ('measurement', 0.001), ('command', 0.002))
    }
    bag = write_bag(tmp_path / 'bag', loop, mcap=True)
    page = report(bag)
    assert '3 s at 100 Hz.' in page.words()
    assert 'Whether samples were lost is not known.' in page.text
    states = write_bag(tmp_path / 'states', {'/x': loop['/arm/measurement'], **loop})
    assert report(states, record(tmp_path / 'runs'), topic='measurement=/x').data['runs']
    assert nadrc('report', states, '--topic', 'measurement').exit_code == 2
    assert '/arm' in nadrc('report', states, '--topic', 'measurement=/y').output


def test_a_csv_file_is_reported_in_part_and_how_it_was_read_is_said(tmp_path: Path) -> None:
    log = tmp_path / 'my log.csv'
    rows = ''.join(f'{k},{k % 7},{k % 5},1\n' for k in range(0, 4000, 10))
    log.write_text('t [ms],Drehzahl,pwm,ziel\n' + rows)
    page = report(log, measurement='Drehzahl', reference='ziel', **{'from': 1, 'to': 2})
    assert '1.01 s at 100 Hz. ' in page.words()
    assert 'Nothing was lost' not in page.text and 'lockstep' not in page.text
    assert page.lines('output') and not page.lines('measurement')  # the one is the other
    done = nadrc('report', log, '--measurement', 'drehzahl', '--page', tmp_path / 'p.html')
    assert 'measurement Drehzahl, command pwm (guessed by its name), no reference' in done.output


def test_by_default_the_page_is_in_the_folder_of_the_run(tmp_path: Path) -> None:
    first, second = record(tmp_path), record(tmp_path)
    assert str(first / 'report.html') in nadrc('report', first).output
    assert nadrc('report', first, second).exit_code == 0
    assert (first / 'report.html').is_file() and (first / 'comparison.html').is_file()
    assert not list(first.glob('.*'))
    assert nadrc('report', *tmp_path.glob('*')).exit_code == 0


@pytest.mark.parametrize('suffix', ['png', 'svg'])
def test_a_picture_needs_no_bokeh(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = record(tmp_path)
    describe(run, '/a$b$^')
    append_parameters(run, 1.5, '/a$b$^/controller', {'b0': 3.0, 'file': '$^$'})
    append_parameters(run, 1.6, '/a$b$^/controller', {'file': '$$^'})
    for name in [n for n in sys.modules if n.startswith(('nadrc_ros.report.p', 'bokeh'))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'bokeh', None)
    picture = tmp_path / f'a.{suffix}'
    assert nadrc('report', run, '--plot', picture).exit_code == 0
    assert picture.read_bytes()[:4] in (b'\x89PNG', b'<?xm')
    done = nadrc('report', run)
    assert done.exit_code == 1
    assert "pip install 'bokeh>=3.7,<4' jinja2" in done.output
    assert nadrc('report', run, '--plot', 'a.gif').exit_code == 2


def test_what_is_no_run_is_named(tmp_path: Path) -> None:
    done = nadrc('report', record(tmp_path / 'runs'), tmp_path / 'nothing')
    assert (done.exit_code, done.output.count('\n')) == (1, 1)
    assert f'{tmp_path / "nothing"}: there is no such file' in done.output
    assert nadrc('report').exit_code == 2
