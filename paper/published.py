"""The numbers that the paper prints: its Table I, and those beside its figure 4."""

from __future__ import annotations

TABLE_1 = {
    'c_clean_itae': 1.714331,
    'c_clean_isu': 7.168854,
    'n_clean_itae': 1.331774,
    'n_clean_isu': 6.630304,
    'c_noisy_itae': 7.066944,
    'c_noisy_isu': 457.302382,
    'n_noisy_itae': 2.128657,
    'n_noisy_isu': 310.913988,
}
FIGURE_4 = {'e3_itae': 10.5769, 'zeta3_itae': 5.8251}
ALL = TABLE_1 | FIGURE_4
CASES = ('clean', 'noisy')
FIGURES = ('itae', 'isu')
