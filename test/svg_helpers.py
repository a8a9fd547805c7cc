"""Whether two pictures of matplotlib, as SVG, show the same: their texts, and their lines."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

import numpy as np
from scipy.spatial import cKDTree

# How far a line may be off, of the height of its panel, and how densely that is looked at.
_OFF, _STEP = 0.004, 0.002


def differences(old: str, new: str) -> list[str]:
    """Return what the pictures do not share, as sentences; places of texts do not count."""
    one, other = (ElementTree.fromstring(text) for text in (old, new))
    texts = [sorted(_texts(root)) for root in (one, other)]
    found = [f'text {text!r} on one side only' for text in set(texts[0]) ^ set(texts[1])]
    lines, others = _lines(one), _lines(other)
    found += [f'{name} on one side only' for name in lines.keys() ^ others.keys()]
    for name in lines.keys() & others.keys():
        off = _distance(lines[name], others[name])
        found += [f'{name} is off by {off:.3g} of its panel'] if off > _OFF else []
    return found


def _texts(root: Any) -> list[str]:
    return [''.join(each.itertext()).strip() for each in root.iter() if each.tag.endswith('}text')]


def _lines(root: Any) -> dict[str, Any]:
    """Return the points of each named line, in shares of its panel."""
    paths = {
        each.get('id'): _points(next(p for p in each.iter() if p.tag.endswith('}path')).get('d'))
        for each in root.iter()
        if re.match(r'(panel|line) \d', each.get('id', ''))
    }
    assert any(name.startswith('line') for name in paths)
    found = {}
    for name, points in paths.items():
        if name.startswith('line'):
            panel = paths[f'panel {name.split()[1]}']
            low, high = panel.min(axis=0), panel.max(axis=0)
            found[name] = (points - low) / (high - low)
    return found


def _points(path: str) -> Any:
    return np.array(re.findall(r'[ML] (\S+) (\S+)', path), dtype=float).reshape(-1, 2)


def _distance(one: Any, other: Any) -> float:
    """Return how far a point of one line is from the other one at most."""
    dense = [_dense(points) for points in (one, other)]
    if not all(map(len, dense)):
        return 0.0 if len(dense[0]) == len(dense[1]) else np.inf
    trees = [cKDTree(points) for points in dense]
    return max(float(trees[1 - k].query(dense[k])[0].max()) for k in (0, 1))


def _dense(points: Any) -> Any:
    """Return points on the line between its corners, no farther apart than a step."""
    lengths = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
    along = np.concatenate([[0.0], np.cumsum(lengths)])[: len(points)]
    if not along.size or not along[-1]:
        return points
    at = np.linspace(0.0, along[-1], int(along[-1] / _STEP) + 2)
    return np.column_stack([np.interp(at, along, column) for column in points.T])
