"""All sections of the reproduction: measured, checked, and put into files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
import json
from typing import Any

from nadrc_ros.atomic import FORMAT, format_of
from nadrc_ros.report.style import render
from paper.article import article
from paper.drawing import FORMATS
from paper.section import Result, Section

# The order of the article.
MODULES = (
    'table1',
    'figures34',
    'attribution',
    'fair',
    'bounds',
    'rates',
    'differentiator',
    'startup',
)
Results = dict[str, Result]


def sections() -> tuple[Section, ...]:
    """Return every section, in the order of the article."""
    return tuple(import_module(f'paper.{module}').SECTION for module in MODULES)


def measure(
    chosen: Sequence[Section],
    tell: Callable[[Section, float], None],
    jobs: int,
    quick: bool = False,
) -> Results:
    """
    Measure the sections one after the other; ``tell`` hears of the share of each that is done.

    ``quick`` takes the smaller measurement of the sections that have one: for a look, not for
    the tolerances.
    """
    results = {}
    for section in chosen:
        measured = section.quick if quick and section.quick else section.measure
        tell(section, 0.0)
        results[section.name] = measured(lambda share: tell(section, share), jobs)  # noqa: B023
        tell(section, 1.0)
    return results


def violations(chosen: Sequence[Section], results: Results) -> list[str]:
    """Return a sentence for each number out of the tolerance that its section declares."""
    return [sentence for section in chosen for sentence in section.check(results[section.name])]


def files(chosen: Sequence[Section], results: Results, quick: bool = False) -> dict[str, bytes]:
    """Return the contents of every file by name: the same bytes for the same results."""
    found = {'paper.json': as_json(results, quick)}
    svgs: dict[str, dict[str, str]] = {}
    for section in chosen:
        svgs[section.name] = {}
        for stem, figure in section.figures(results[section.name]).items():
            for file_format in FORMATS:
                found[f'{stem}.{file_format}'] = render(figure, file_format)
            svgs[section.name][stem] = found[f'{stem}.svg'].decode()
    found['index.html'] = article(chosen, results, svgs, quick).encode()
    return found


def as_json(results: Mapping[str, Any], quick: bool) -> bytes:
    """
    Return paper.json: what was measured, and nothing that changes from run to run.

    Beside the result of each section it has Table I under ``scenarios``, for other programs.
    """
    scenarios = {
        name: {'table1': scenario['table1']}
        for name, scenario in results['table1']['scenarios'].items()
    }
    whole = {FORMAT: format_of('paper'), 'quick': quick, 'scenarios': scenarios, **results}
    return (json.dumps(whole, indent=1, allow_nan=False, ensure_ascii=False) + '\n').encode()
