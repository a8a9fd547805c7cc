"""The halves of the tutorials that need no ROS, followed by their text alone."""

from __future__ import annotations

from pathlib import Path
import re

import numpy as np
import pytest
from tutorial_helpers import follow, part, ROOT


def test_a_loop_on_your_laptop(tmp_path: Path) -> None:
    text = part('tutorial_laptop.md', '## A loop in ten lines', '## The same on ROS 2')
    assert follow(text, tmp_path) == 4
    assert (tmp_path / 'cart.png').exists()


def test_from_the_log_of_a_pid_to_a_tuned_loop(tmp_path: Path) -> None:
    pytest.importorskip('mujoco', reason='the test extra brings it')
    (tmp_path / 'examples').symlink_to(ROOT / 'examples')
    text = part('tutorial_log.md', '## The log', '## A log of')
    assert follow(text, tmp_path) == 4
    out = tmp_path / 'out' / 'arm'
    assert (out / 'arms.html').exists()
    (row,) = re.findall(r'^\| ITAE .*?\| (.*) \|$', text, re.MULTILINE)
    shown = [float(cell) for cell in row.split('|')]
    logs = ROOT / 'examples' / 'logs' / 'arm_pid.csv', out / 'start.csv', out / 'tuned.csv'
    found = [itae(log) for log in logs]
    assert found[:2] == pytest.approx(shown[:2], rel=0.01)
    assert found[2] < 2.0 * shown[2]  # other versions of Optuna choose other designs


def itae(log: Path) -> float:
    """Return the integral of t |e| of a log of the arm."""
    time, wanted, angle, _ = np.loadtxt(log, delimiter=',', skiprows=1, unpack=True)
    return float(np.sum(time * np.abs(wanted - angle)) * 0.01)


def test_the_log_of_the_arm_is_that_of_its_script(tmp_path: Path) -> None:
    pytest.importorskip('mujoco', reason='the test extra brings it')
    script = ROOT / 'examples' / 'logs' / 'record_arm.py'
    follow(f'```bash\npython {script} again.csv\n```\n', tmp_path)
    again = np.loadtxt(tmp_path / 'again.csv', delimiter=',', skiprows=1)
    shipped = np.loadtxt(script.with_name('arm_pid.csv'), delimiter=',', skiprows=1)
    np.testing.assert_allclose(again, shipped, atol=0.02)


def test_an_output_that_differs_is_found(tmp_path: Path) -> None:
    text = '```bash\necho 1.47\necho more\n```\n```text\n1.{}\n...\n```\n'
    assert follow(text.format(47), tmp_path) == 1
    with pytest.raises(AssertionError):
        follow(text.format(48), tmp_path)
