"""A run reads the same from the recorder's folder and from a bag of its topics."""

from __future__ import annotations

from collections.abc import Callable
import json
from math import nan
from pathlib import Path
from shutil import copytree
import sys

from bag_helpers import write_bag
from nadrc_ros.adrc.errors import UserError
from nadrc_ros.atomic import write_json
from nadrc_ros.records.figures import summarise
from nadrc_ros.records.history import append_parameters
from nadrc_ros.records.read_run import read_run, read_runs
from nadrc_ros.records.recording import RunFolder, RunSettings
from nadrc_ros.records.source import Source
import numpy as np
import pytest
from rosbags.rosbag2 import CompressionMode

EARLIER = Path(__file__).parent / 'data' / 'earlier_run'
H = 0.01
# Reference from 20 ms on; measurement k at k h; the command in reply comes 0.3 ms later, the
# first one to measurement 2.
MEASURED = [(H * k, float(k)) for k in range(6)]
COMMANDED = [(H * k + 3e-4, -float(k)) for k in range(2, 6)]
REFERENCE = [(0.035, 7.0)]
LOOP = {'reference': REFERENCE, 'measurement': MEASURED, 'command': COMMANDED}


def in_namespace(name: str) -> dict[str, list[tuple[float, float]]]:
    return {f'{name}/{topic}': pairs for topic, pairs in LOOP.items()}


@pytest.mark.parametrize('mcap', [False, True])
def test_a_row_of_a_bag_is_a_measurement_and_the_command_that_acted_until_the_next(
    mcap: bool, tmp_path: Path
) -> None:
    signals = in_namespace('') | {
        '/controller/level_2/disturbance': [(0.0204, 4.0), (0.0304, 5.0)],
        '/plant/output': [(0.0201, 2.5)],
    }
    folder = write_bag(tmp_path / 'bag', signals, mcap, words=('/rosout',))
    for path in (folder, next(p for p in folder.iterdir() if p.suffix != '.yaml')):
        run = read_run(path)
        assert run.rate == pytest.approx(100.0)
        assert run.columns['time'] == pytest.approx([0.0, 0.01, 0.02, 0.03])
        assert run.columns['measurement'].tolist() == [2.0, 3.0, 4.0, 5.0]
        assert run.columns['command'].tolist() == [-2.0, -3.0, -4.0, -5.0]
        assert run.columns['level_2'].tolist() == [4.0, 5.0, 5.0, 5.0]
        assert run.columns['output'][0] == 2.5  # and that of no other row
        assert np.isnan(run.columns['output'][1:]).all()
        np.testing.assert_array_equal(run.columns['reference'], [nan, nan, 7.0, 7.0])
        assert run.summary == {} and 'level_1' not in run.columns


def test_a_folder_of_the_recorder_reads_as_it_was_written(tmp_path: Path) -> None:
    columns = ('time', 'reference', 'measurement', 'command', 'level_1')
    folder = RunFolder(tmp_path, columns, RunSettings(rate=50.0))
    rows = [[0.0, nan, 1.0, 2.0, nan], [0.06, 0.5, 1.5, 2.5, 3.5]]
    for row in rows:
        folder.write(row)
    folder.close()
    run = read_run(folder.path)
    assert (run.path, run.rate, run.summary) == (folder.path, 50.0, {})
    np.testing.assert_array_equal(list(run.columns.values()), np.transpose(rows))
    folder.write_summary({'rows': 2})
    assert read_run(folder.path).summary == {'rows': 2}


def test_a_folder_of_an_earlier_version_means_what_it_did() -> None:
    """Its rows are periods of a fixed rate, and it says nothing of a settle time."""
    run = read_run(EARLIER)
    assert run.rate == 20.0
    assert run.columns['time'].tolist() == [k / 20.0 for k in range(60)]
    found, recorded = summarise(EARLIER), run.summary
    assert {name: found['metrics'][name] for name in recorded['metrics']} == recorded['metrics']
    for name in ('rows', 'periods', 'rate', 'error'):
        assert found[name] == recorded[name]
    (change,) = run.history.changes
    assert [(change.name, change.before, change.after)] == [('inner_bandwidth', 8.0, 6.0)]
    assert run.history.events == []
    assert run.metrics.as_dict() == found['metrics']
    assert (run.gaps, run.figure_settings.settle_time) == (0, 2.0)


@pytest.mark.parametrize('kind', ['run', 'about', 'summary'])
def test_a_later_format_is_refused_by_name_and_that_of_today_is_read(
    kind: str, tmp_path: Path
) -> None:
    folder = copytree(EARLIER, tmp_path / 'run')
    file = folder / f'{kind}.json'
    content = json.loads(file.read_bytes())
    write_json(file, kind, content)
    assert json.loads(file.read_bytes()) == {'format': f'nadrc/{kind} 1', **content}
    assert read_run(folder).rate == read_run(EARLIER).rate
    file.write_text(json.dumps({**content, 'format': f'nadrc/{kind} 2'}), encoding='utf-8')
    with pytest.raises(UserError, match=f'^{kind}.json: .* nadrc/{kind} 2, .*: a later version'):
        read_run(folder)
    write_json(file, 'design', content)
    with pytest.raises(UserError, match=f'its format is nadrc/design 1, not nadrc/{kind} 1$'):
        read_run(folder)


def test_a_folder_has_the_rate_of_its_measurements(tmp_path: Path) -> None:
    """Also one of some rows in an hour; rows of the truth, in silence of the sensor, count not."""
    columns = ('time', 'reference', 'measurement', 'command', 'output')
    for period in (0.0025, 5.0, 900.0):
        folder = RunFolder(tmp_path, columns, RunSettings())
        for k in range(300):
            silent = 100 <= k < 140
            folder.write([period * k, 1.0, nan if silent else 0.5, 2.0, 0.5])
            if silent:
                folder.write([period * (k + 0.5), 1.0, nan, 2.0, 0.5])
        folder.close()
        run = read_run(folder.path)
        assert run.rate == pytest.approx(1.0 / period)
        assert run.gaps == 40
        found = summarise(folder.path)
        assert found['metrics']['iae'] == pytest.approx(150.0 * period)
        assert (found['rows'], found['gap_time']) == (340, 0.0)


def test_a_folder_has_the_rate_that_its_plant_was_asked_for(tmp_path: Path) -> None:
    """Its times alone may tell another: timers of a busy machine drift."""
    folder = RunFolder(tmp_path, ('time', 'reference', 'measurement', 'command'), RunSettings())
    for k in range(300):
        folder.write([k / 200.6, 1.0, 0.5, 2.0])
    folder.close()
    append_parameters(folder.path, None, '/plant', {'plant': 'paper', 'noise_variance': 0.0})
    assert read_run(folder.path).rate == pytest.approx(200.6)
    append_parameters(folder.path, None, '/plant', {'rate': 200.0})
    assert read_run(folder.path).rate == 200.0


def test_the_rate_of_a_bag_is_right_with_jitter_and_lost_measurements(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    times = [k / 125.0 + rng.uniform(0.0, 2e-3) for k in range(500) if k % 9]
    loop = {name: [(t, 1.0) for t in times] for name in ('/measurement', '/command')}
    assert read_run(write_bag(tmp_path / 'bag', loop)).rate == pytest.approx(125.0, rel=1e-3)


def test_a_reference_is_that_at_the_measurement_of_its_row(tmp_path: Path) -> None:
    """Between samples where it moves, held where it steps or is sent now and then."""
    rng = np.random.default_rng(2)
    times = np.arange(500) * H
    sent = times + rng.uniform(0.0, 0.9 * H, 500) - 0.5 * H  # by a timer of any phase, late or not
    moving = [*zip(sent[:100], np.sin(sent[:100])), *zip(sent[104:], np.sin(sent[104:]))]
    steps = [(t, float(t > 2.0)) for t in sent]
    seldom = [(0.0, 1.0), (2.005, 2.0), (3.505, 5.0)]
    for number, reference in enumerate((moving, steps, seldom)):
        loop = {'/reference': [(1.0 + t, r) for t, r in reference]}
        loop |= {name: [(1.0 + t, 0.0) for t in times] for name in ('/measurement', '/command')}
        run = read_run(write_bag(tmp_path / str(number), loop))
        found = run.columns['reference'][2:-2]
        if reference is moving:
            np.testing.assert_allclose(found, np.sin(times[2:-2]), atol=1e-3)
        else:
            assert set(found) == {r for _, r in reference}


def test_a_bag_with_a_gap_has_the_figures_of_its_times(tmp_path: Path) -> None:
    times = [*np.arange(0, 2, H), *np.arange(3, 5, H)]
    loop = {name: [(1.0 + t, 0.0) for t in times] for name in ('/measurement', '/command')}
    loop['/reference'] = [(0.9, 1.0)]
    subject = read_run(write_bag(tmp_path / 'bag', loop))
    assert subject.metrics.iae == pytest.approx(4.0)
    assert subject.gap_time == pytest.approx(1.0)


def test_a_bag_whose_measurements_end_before_its_commands_has_a_gap_up_to_the_end(
    tmp_path: Path,
) -> None:
    loop: dict[str, list[tuple[float, float]]] = {
        '/measurement': [(1.0 + t, 0.0) for t in np.arange(0, 3, H)],
        '/reference': [(0.9, 1.0)],
    }
    loop['/command'] = [(1.0 + t, 0.0) for t in np.arange(0, 5, H)]
    bag = write_bag(tmp_path / 'bag', loop)
    run = read_run(bag)
    assert run.stop == pytest.approx(5.0 - H)
    assert run.metrics.iae == pytest.approx(3.0)
    assert run.gap_time == pytest.approx(2.0 - H)
    assert run.gaps == round(2.0 / H) - 1
    (part,) = read_runs([bag], begin=1.0, end=4.0).values()
    assert part.gap_time == pytest.approx(1.0)
    assert part.metrics.iae == pytest.approx(2.0)


def test_the_loop_is_found_in_its_only_namespace_and_asked_for_among_several(
    tmp_path: Path,
) -> None:
    one = write_bag(tmp_path / 'one', in_namespace('/arm/left'))
    assert read_run(one).columns['measurement'][0] == 2.0
    both = write_bag(tmp_path / 'both', in_namespace('/a') | in_namespace('/b'))
    with pytest.raises(UserError, match='/a/measurement, /b/measurement'):
        read_run(both)
    for name in ('b', '/b', '/b/'):
        assert read_run(both, Source(namespace=name)).columns['command'][0] == -2.0


def test_topics_of_other_names_can_be_named(tmp_path: Path) -> None:
    path = write_bag(tmp_path / 'bag', {'/x/state': MEASURED, '/x/effort': COMMANDED})
    run = read_run(path, Source(signals={'measurement': '/x/state', 'command': '/x/effort'}))
    assert run.columns['command'].tolist() == [-2.0, -3.0, -4.0, -5.0]
    assert np.isnan(run.columns['reference']).all()


@pytest.mark.parametrize(
    ('compressed', 'mcap'),
    [
        (CompressionMode.FILE, False),
        (CompressionMode.FILE, True),
        (CompressionMode.MESSAGE, False),
        (CompressionMode.MESSAGE, True),
        (CompressionMode.STORAGE, True),
    ],
)
def test_a_compressed_bag_reads_as_the_plain_one(
    compressed: CompressionMode, mcap: bool, tmp_path: Path
) -> None:
    plain = read_run(write_bag(tmp_path / 'plain', in_namespace(''), mcap))
    folder = write_bag(tmp_path / 'packed', in_namespace(''), mcap, compressed=compressed)
    paths = [folder]
    if compressed == CompressionMode.FILE:
        (file,) = folder.glob('*.zstd')
        paths.append(file)
    for path in paths:
        for name, column in plain.columns.items():
            np.testing.assert_array_equal(read_run(path).columns[name], column)
    if compressed == CompressionMode.FILE:
        (folder / 'metadata.yaml').unlink()  # as a recording that was killed leaves it
        assert read_run(folder).columns['command'].tolist() == [-2.0, -3.0, -4.0, -5.0]
        file.write_bytes(file.read_bytes()[:-20])
        with pytest.raises(UserError, match='not a bag that can be read'):
            read_run(folder)


def empty_folder(path: Path) -> tuple[Path, dict[str, str]]:
    return path, {}


def no_file(path: Path) -> tuple[Path, dict[str, str]]:
    return path / 'nothing', {}


def no_command(path: Path) -> tuple[Path, dict[str, str]]:
    loop = {'/measurement': MEASURED, '/b/effort': MEASURED, '/a/other': MEASURED}
    return write_bag(path / 'bag', loop, words=('/rosout',)), {}


def no_signal(path: Path) -> tuple[Path, dict[str, str]]:
    return write_bag(path / 'bag', LOOP), {'measured': '/measurement'}


def other_topic(path: Path) -> tuple[Path, dict[str, str]]:
    return write_bag(path / 'bag', in_namespace('')), {'measurement': '/states'}


def near_topic(path: Path) -> tuple[Path, dict[str, str]]:
    return write_bag(path / 'bag', in_namespace('')), {'measurement': '/mesurement'}


def text_topic(path: Path) -> tuple[Path, dict[str, str]]:
    return write_bag(path / 'bag', in_namespace(''), words=('/state',)), {'measurement': '/state'}


def silent_topic(path: Path) -> tuple[Path, dict[str, str]]:
    return write_bag(path / 'bag', in_namespace('') | {'/command': []}), {}


def rubbish(suffix: str) -> Callable[[Path], tuple[Path, dict[str, str]]]:
    def make(path: Path) -> tuple[Path, dict[str, str]]:
        file = path / f'bag{suffix}'
        file.write_bytes(b'rubbish' * 100)
        return file, {}

    return make


def bad_metadata(path: Path) -> tuple[Path, dict[str, str]]:
    bag = write_bag(path / 'bag', in_namespace(''))
    (bag / 'metadata.yaml').write_text('{')
    return bag, {}


def cut_short(path: Path) -> tuple[Path, dict[str, str]]:
    bag = write_bag(path / 'bag', in_namespace(''), mcap=True)
    (file,) = bag.glob('*.mcap')
    file.write_bytes(file.read_bytes()[:300])
    return bag, {}


@pytest.mark.parametrize(
    ('make', 'said'),
    [
        (empty_folder, 'neither a folder with samples.csv nor a rosbag2 bag'),
        (no_file, 'there is no such file'),
        (no_command, '^no topic /command: name .* with --command; .*have /a/other, /b/effort$'),
        (no_signal, "there is no signal 'measured': did you mean measurement"),
        (other_topic, '^no topic /states: there are /command, /measurement, /reference'),
        (near_topic, '^no topic /mesurement: did you mean /measurement?'),
        (text_topic, '/state has std_msgs/msg/String, not one number'),
        (silent_topic, 'no message on /command'),
        (rubbish('.db3'), 'not a bag that can be read'),
        (rubbish('.mcap'), 'not a bag that can be read'),
        (rubbish('.mcap.zstd'), 'not a bag that can be read'),
        (bad_metadata, 'not a bag that can be read'),
        (cut_short, 'not a bag that can be read'),
    ],
)
def test_what_is_no_run_is_refused_in_one_sentence(
    make: Callable[[Path], tuple[Path, dict[str, str]]], said: str, tmp_path: Path
) -> None:
    path, topics = make(tmp_path)
    with pytest.raises(UserError, match=said) as caught:
        read_run(path, Source(signals=topics))
    assert '\n' not in str(caught.value)


def test_without_rosbags_a_bag_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bag(tmp_path / 'bag', in_namespace(''))
    for name in [name for name in sys.modules if name.split('.')[0] == 'rosbags']:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UserError, match='pip install rosbags'):
        read_run(path)
