"""The linear law with one level against an independent implementation of the same equations."""

from __future__ import annotations

from law_helpers import Chain, design_of, Law, noise
from nadrc_ros.adrc.status import Status
import pyadrc
import pytest

H = 0.01


@pytest.mark.parametrize('half', (False, True))
@pytest.mark.parametrize('b0', (1.0, -0.5))
@pytest.mark.parametrize('n', (1, 2))
def test_commands_equal_those_of_pyadrc(n: int, b0: float, half: bool) -> None:
    """Over 2000 noisy steps, with rate and magnitude limits that are often reached."""
    limits, wc, ratio, start = (-6.0, 9.0), 4.0, 10.0, 0.3
    rate = 60.0 if n == 1 else 400.0
    ours = Law(
        design_of(
            plant_order=n,
            structure='conventional',
            b0=b0,
            controller_bandwidth=wc,
            inner_bandwidth=ratio * wc,
            observer_gain_factor=0.5 if half else 1.0,
            command_min=limits[0],
            command_max=limits[1],
            command_rate_limit=rate,
        ),
        start,
    )
    theirs = pyadrc.StateSpace(
        order=n,
        delta=H,
        b0=b0,
        w_cl=wc,
        k_eso=ratio,
        eso_init=(start, *[0.0] * n),
        m_lim=limits,
        r_lim=(-rate * H, rate * H),
        half_gain=(False, half),
    )
    chain, other, statuses = Chain(n), 0.0, []
    chain.x[0] = start
    for k, (v, w) in enumerate(zip(noise(1, 2000, 0.02), noise(2, 2000, 3.0))):
        y, r = chain.y + v, 1.0 if k % 500 < 250 else -2.0
        other = theirs(y, other, r)
        u = ours.step([r], y, H)
        assert abs(u - other) < 1e-9, k
        statuses.append(ours.status)
        chain.advance(b0 * u + w, H)
    for status in (Status.OK, Status.RATE_LIMITED, Status.SATURATED):
        assert statuses.count(status) > 30, status
