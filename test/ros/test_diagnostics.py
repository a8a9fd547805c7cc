"""What keeps a log readable."""

from __future__ import annotations

from nadrc_ros.nodes.diagnostics import Budget


def test_a_budget_lets_so_many_through_per_time_and_counts_the_rest() -> None:
    budget = Budget(3, 10.0)
    assert [budget.allows(t) for t in (0.0, 1.0, 2.0, 3.0, 9.9)] == [True] * 3 + [False] * 2
    assert budget.refused == 2
    assert [budget.allows(t) for t in (10.0, 10.5, 11.0)] == [True, False, True]
