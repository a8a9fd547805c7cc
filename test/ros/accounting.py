"""Whether a recorder lost anything that it did not count."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
import json
from math import isnan
from pathlib import Path

from nadrc_ros.records.recording import read_samples, SUMMARY


def check_rows(
    folder: Path, rate: float, published: Iterable[tuple[float, int]]
) -> tuple[int, int]:
    """
    Compare a run, row by row, with ``published`` measurements and their publication numbers.

    Of these some may be missing; a value tells the number where it came once. Return how many rows
    there are, and how many measurements the recorder says that it lost.
    """
    published = list(published)
    times = Counter(value for value, _ in published)
    heard = {number for _, number in published}
    # A busy listener misses some, such as one of two that are equal.
    numbers = {
        value: number
        for value, number in published
        if times[value] == 1 and {number - 1, number + 1} <= heard
    }
    samples = read_samples(folder)
    pairs = zip(samples['measurement'], samples['measurement_stamp'])
    rows = [value for value, stamp in pairs if not isnan(stamp)]
    known = [(place, numbers[value]) for place, value in enumerate(rows) if value in numbers]
    # What was lost shifts the rows behind it, and never back.
    behind = [number - place for place, number in known]
    assert behind == sorted(behind)
    summary = json.loads((folder / SUMMARY).read_text(encoding='utf-8'))
    lost: int = summary['samples_lost_by_signal'].get('measurement', 0)
    assert summary['rows'] == len(samples['time'])
    # What lies between two known rows is a row or is counted; outside them some may be lost too.
    (begin, first), *_, (end, last) = known
    missing = last - first - (end - begin)
    outside = 0.0 if (begin, end) == (0, len(rows) - 1) else rate
    assert missing <= lost <= missing + outside
    return len(rows), lost
