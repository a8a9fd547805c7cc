"""From a guess to `identify`, `design` and `tune`: each step is at least as good as before."""

from __future__ import annotations

from bench.path import path, PLANTS
import pytest

# Of the bench's plants those that are quick; unseen noise moves the figures by so much.
QUICK = ('speed', 'axis behind a bus', 'upside down')
NOISE = 1.05


@pytest.mark.parametrize('name', QUICK)
def test_each_step_of_the_path_is_at_least_as_good_as_the_one_before(name: str) -> None:
    """On the true plant, by ITAE and by peak error, within the effort of the start."""
    found = path(PLANTS[name], designs=8)
    for figure in ('', '.peak'):
        before = 1.0
        for step in ('start', 'design', 'tuned'):
            now = found[f'{step}{figure}']
            assert now <= NOISE * before, (step, figure, found)
            before = now
