"""A section of the reproduction: one question, measured, drawn, and what is declared of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import inf
from typing import Any

import attrs
from matplotlib.figure import Figure

# What a section measured: numbers, strings, lists and mappings, as JSON holds them.
Result = dict[str, Any]
# Receives the share of the work that is done, from 0 to 1, never less than before.
Tell = Callable[[float], None]


def _numbers(values: float | Sequence[float]) -> tuple[float, ...]:
    found = values if isinstance(values, Sequence) else (values,)
    return tuple(map(float, found))


@attrs.frozen(kw_only=True)
class Finding:
    """
    A number of the article, or one for each case, with the range that is declared for it.

    A sentence of the article takes its numbers and its verdict from findings, so that none can
    stay when the measurement moves; a value outside ``low`` to ``high`` fails ``make paper``.

    Attributes
    ----------
    says
        What is measured, for the sentence on a value out of range.
    values
        The measured values.
    low, high
        The declared range, inclusive.

    """

    says: str
    values: tuple[float, ...] = attrs.field(converter=_numbers)
    low: float = -inf
    high: float = inf

    @property
    def holds(self) -> bool:
        """Tell whether every value is in the declared range; one that is not a number is not."""
        return all(self.low <= value <= self.high for value in self.values)

    @property
    def least(self) -> float:
        """Return the smallest value."""
        return min(self.values)

    @property
    def most(self) -> float:
        """Return the largest value."""
        return max(self.values)

    def violation(self) -> str:
        """Say what is out of range, and by which value."""
        outside = [value for value in self.values if not self.low <= value <= self.high]
        worst = max(outside, key=lambda value: max(self.low - value, value - self.high))
        return f'{self.says}: {worst:.4g}, declared is {self.low:.4g} to {self.high:.4g}'


Findings = Mapping[str, Finding]


@attrs.frozen(kw_only=True)
class Section:
    """
    One experiment of the reproduction.

    Attributes
    ----------
    name
        Key of its result in paper.json and stem of its files: a Python identifier.
    title
        Heading of the article.
    measure
        ``measure(tell, jobs)`` runs it on up to ``jobs`` processors. The result depends neither
        on ``jobs`` nor on anything else than the seeds and scenarios that the section declares.
    figures
        ``figures(result)`` draws a result, also one read back from JSON; by file stem.
    findings
        ``findings(result)`` returns the numbers that the article tells, with what is declared of
        them, by name.
    quick
        The same measurement on a smaller scale, of the same form, for a first look in a few
        seconds; None where ``measure`` is quick already. Its result is not checked.

    """

    name: str
    title: str
    measure: Callable[[Tell, int], Result]
    figures: Callable[[Result], dict[str, Figure]]
    findings: Callable[[Result], Findings]
    quick: Callable[[Tell, int], Result] | None = None

    def check(self, result: Result) -> list[str]:
        """Return a sentence for each finding out of its declared range, none if all is well."""
        return [
            f'{self.name}: {finding.violation()}'
            for finding in self.findings(result).values()
            if not finding.holds
        ]
