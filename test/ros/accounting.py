"""Whether a recorder lost anything that it did not count."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
import json
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
    indices = [round(t * rate) for t in samples['time']]
    rows = list(zip(indices, samples['measurement']))
    known = [(i, *row) for i, row in enumerate(rows) if row[1] in numbers]
    # Periods without a measurement shift the rows behind them, and never back.
    ahead = [index - numbers[value] for _, index, value in known]
    assert ahead == sorted(ahead)
    summary = json.loads((folder / SUMMARY).read_text(encoding='utf-8'))
    lost: int = summary['samples_lost_by_signal'].get('measurement', 0)
    assert summary['rows'] == len(indices)
    assert summary['periods'] == indices[-1] + 1
    # What lies between two known rows is a row or is counted; outside them some may be lost too.
    (begin, _, first), *_, (end, _, last) = known
    missing = numbers[last] - numbers[first] - (end - begin)
    outside = 0.0 if (begin, end) == (0, len(rows) - 1) else rate
    assert missing <= lost <= missing + outside
    return len(indices), lost
