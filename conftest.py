"""
What all tests need, and what `make soak` asks for.

That is longer runs of the tests of promise 20, and more random cases.
"""

import os
import signal

from hypothesis import HealthCheck, Phase, settings
import pytest

# As the commands do, and before NumPy is imported: with threads of its own, which wait busily,
# OpenBLAS takes ten times the CPU for small matrices as soon as the cores have other work.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
# What a shell starts in the background ignores it, and so would all that the tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)
# A busy machine may keep any example waiting.
settings.register_profile('test', deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile('soak', settings.get_profile('test'), max_examples=100_000)
# Whether an example fails is enough there, the simplest one is not sought.
settings.register_profile(
    'mutants', settings.get_profile('test'), phases=(Phase.explicit, Phase.generate)
)
settings.load_profile('test')


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what the tests of promise 20 read."""
    parser.addoption('--soak', action='store_true', help='ten minutes of faults, not one')
    parser.addoption('--seed', type=int, default=1, help='seed of these faults')


@pytest.fixture(scope='session')
def soak(request: pytest.FixtureRequest) -> bool:
    """Tell whether this is the long run."""
    return bool(request.config.getoption('--soak'))


@pytest.fixture(scope='session')
def seed(request: pytest.FixtureRequest) -> int:
    """Return the seed, and print it."""
    seed = int(request.config.getoption('--seed'))
    print(f'seed {seed}')
    return seed
