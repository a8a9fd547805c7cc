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
    numbers = {value: number for value, number in published if times[value] == 1}
    samples = read_samples(folder)
    indices = [round(t * rate) for t in samples['time']]
    rows = list(zip(indices, samples['measurement']))
    # Periods without a measurement shift the rows behind them, and never back.
    ahead = [index - numbers[value] for index, value in rows if value in numbers]
    assert ahead == sorted(ahead)
    summary = json.loads((folder / SUMMARY).read_text(encoding='utf-8'))
    lost: int = summary['samples_lost_by_signal'].get('measurement', 0)
    assert summary['rows'] == len(indices)
    assert summary['periods'] == indices[-1] + 1
    assert len(indices) + lost + ahead[-1] - ahead[0] == summary['periods']
    return len(indices), lost
