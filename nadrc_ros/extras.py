"""
Packages of Python that only some commands need, and what to say where one is not installed.

They are named one by one, and not as ``nadrc_ros[tune]``: this package is on no index, and where
it was built from is not known once it is installed. Those of ``setup.py`` are the same.
"""

from __future__ import annotations

from os.path import relpath
from shlex import join
import sys

from nadrc_ros.adrc.errors import UserError

EXTRAS = {
    'tune': ('optuna>=5,<6', 'cmaes', 'pymoo'),
    'sweep': ('dask[distributed]', 'pyarrow'),
    'bags': ('rosbags',),
    'report': ('bokeh>=3.7,<4', 'jinja2'),
}


class MissingPackage(UserError):
    """
    What was asked for needs a package that is not installed.

    Parameters
    ----------
    what, package
        What needs it, and its name.
    install
        The names that pip installs: one of :data:`EXTRAS`, or that of the package.
    instead
        What works without it, in words.

    """

    def __init__(self, what: str, package: object, install: str, instead: str = '') -> None:
        beside = relpath(sys.executable)
        python = sys.executable if beside.startswith('..') else beside
        command = join([python, '-m', 'pip', 'install', *EXTRAS.get(install, (install,))])
        other = f'; {instead}' if instead else ''
        super().__init__(f'{what} needs {package}, which is not installed: {command}{other}')
