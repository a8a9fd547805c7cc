"""What is shipped for the tools of ROS: layouts for live plotting, and a launch file."""

from __future__ import annotations

import ast
import json
from pathlib import Path
import re
from typing import Any
from xml.etree import ElementTree

from nadrc_ros.demo.loop_processes import NODES
from nadrc_ros.nodes.recorder_settings import RecorderSettings
import pytest

ROOT = Path(__file__).resolve().parents[1]
# What the recorder records by default is all that plant, reference and controller publish.
TOPICS = {f'/{topic}' for topic in RecorderSettings().topics().values()}
PAGE = (ROOT / 'docs' / 'robot.md').read_text(encoding='utf-8')
LAUNCH = ROOT / 'launch' / 'nadrc.launch.py'
SHOWN = {'/reference', '/measurement', '/command', '/plant/output', '/plant/total_disturbance'}
SHOWN |= {'/controller/total_disturbance', '/controller/level_2/disturbance'}


def plotjuggler() -> tuple[set[str], set[str]]:
    """Return the topics of the curves, and those that are subscribed to."""
    root = ElementTree.parse(ROOT / 'config' / 'plotjuggler.xml').getroot()
    curves = {curve.attrib['name'].removesuffix('/data') for curve in root.iter('curve')}
    (selected,) = root.iter('selected_topics')
    return curves, set(selected.attrib['value'].split(';'))


def foxglove() -> dict[str, Any]:
    layout = json.loads((ROOT / 'config' / 'foxglove.json').read_text(encoding='utf-8'))
    assert isinstance(layout, dict)
    return layout


def panels(layout: Any) -> list[str]:
    """Return the panels in a (nested) split."""
    if isinstance(layout, str):
        return [layout]
    assert layout['direction'] in ('row', 'column') and 0 < layout['splitPercentage'] < 100
    return panels(layout['first']) + panels(layout['second'])


def test_plotjuggler_shows_topics_that_the_nodes_publish() -> None:
    curves, selected = plotjuggler()
    assert SHOWN <= curves <= TOPICS
    assert curves == selected


def test_each_splitter_of_plotjuggler_has_the_sizes_it_needs() -> None:
    root = ElementTree.parse(ROOT / 'config' / 'plotjuggler.xml').getroot()
    for splitter in root.iter('DockSplitter'):
        sizes = [float(size) for size in splitter.attrib['sizes'].split(';')]
        assert len(sizes) == len(splitter) == int(splitter.attrib['count'])
        assert sum(sizes) == pytest.approx(1.0)


def test_foxglove_shows_topics_that_the_nodes_publish() -> None:
    layout = foxglove()
    shown = {
        path['value'].removesuffix('.data')
        for panel in layout['configById'].values()
        for path in panel.get('paths', [])
    }
    assert SHOWN <= shown <= TOPICS
    assert sorted(panels(layout['layout'])) == sorted(layout['configById'])
    kinds = {name.split('!')[0] for name in layout['configById']}
    assert kinds == {'Plot', 'DiagnosticSummary', 'Parameters'}


def test_the_namespace_that_the_page_adds_is_added_to_every_topic() -> None:
    (pattern, new) = re.findall(r"sed -E 's#(.*)#(.*)#g' FILE", PAGE)[0]
    for name in ('plotjuggler.xml', 'foxglove.json'):
        text = (ROOT / 'config' / name).read_text(encoding='utf-8')
        moved = re.sub(pattern, new, text)
        for topic in SHOWN:
            assert moved.count(f'/axis1{topic}') == text.count(topic) > 0, topic
        assert moved.replace('/axis1', '') == text


def test_the_launch_file_declares_its_arguments_and_starts_our_nodes() -> None:
    """`launch` is no wheel, so the file is read and not run."""
    source = LAUNCH.read_text(encoding='utf-8')
    compile(source, LAUNCH.name, 'exec')
    calls = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)]
    called = [(ast.unparse(call.func), call) for call in calls]
    arguments = [ast.literal_eval(c.args[0]) for name, c in called if name.endswith('Argument')]
    assert arguments == [
        'namespace',
        'nodes',
        'params_file',
        'structure',
        'rate',
        'use_sim_time',
        'remappings',
    ]
    preset = [
        ast.literal_eval(call.args[0])
        for name, call in called
        for word in call.keywords
        if word.arg == 'default_value' and ast.unparse(word.value) != repr('')
    ]
    assert preset == ['nodes']  # any other would overrule params_file
    read = {ast.literal_eval(call.args[0]) for name, call in called if name == 'given'}
    assert read == set(arguments)
    (nodes,) = (
        ast.literal_eval(node.value)
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == 'NODES'
    )
    assert sorted(nodes) == sorted(NODES)


def test_what_is_shipped_is_installed() -> None:
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    assert "glob('config/*.*')" in setup and "glob('launch/*.launch.py')" in setup
