"""The Python package: built by colcon (`ros2 run nadrc_ros ...`) or by pip (`nadrc ...`)."""

from glob import glob
import sys
from xml.etree import ElementTree

from setuptools import find_packages, setup

NAME = 'nadrc_ros'
# What the benches compare with.
RIVALS = ['control==0.10.2', 'pyadrc==0.6.1', 'simple-pid==2.0.1']
# What the site in out/docs is built with.
SITE = ['furo', 'latex2mathml', 'myst-parser', 'sphinx']
# The searches of `nadrc tune`: front, budget, swarm.
TUNE = ['optuna>=5,<6', 'cmaes', 'pymoo']
# The page of `nadrc report`.
REPORT = ['bokeh>=3.7,<4', 'jinja2']
# The machines of examples/mujoco.
MUJOCO = ['mujoco']
# The article of `make paper`.
PAPER = ['jinja2', 'latex2mathml']
NODES = ('controller', 'plant', 'reference', 'recorder')
# The last four are what signals are wired to most.
MESSAGES = (
    *('std-msgs', 'std-srvs', 'diagnostic-msgs'),
    *('geometry-msgs', 'nav-msgs', 'sensor-msgs', 'trajectory-msgs'),
)


def ros_wheels(distribution: str, rclpy: str, messages: str) -> list[str]:
    """Return what is ROS 2 itself on PyPI, for x86-64 Linux only, where none is installed."""
    return [
        f'ros-rclpy[fastrtps]=={rclpy}',
        f'ros-{distribution}-rclpy=={rclpy}',
        *(f'ros-{distribution}-{package}=={messages}' for package in MESSAGES),
    ]


# colcon calls `setup.py install` or `develop`, and setup.cfg puts the scripts into lib/nadrc_ros.
# pip builds a wheel, whose scripts go into the bin/ that all packages share: there the nodes are
# called nadrc-controller etc.
COLCON = bool({'install', 'develop'} & set(sys.argv))
PREFIX = '' if COLCON else 'nadrc-'

setup(
    name=NAME,
    version=ElementTree.parse('package.xml').findtext('version'),
    description='Active disturbance rejection control with nested extended state observers',
    license='Apache-2.0',
    maintainer='nadrc_ros maintainers',
    maintainer_email='maintainers@users.noreply.example.org',
    python_requires='>=3.10',
    packages=find_packages(include=[NAME, f'{NAME}.*']),
    package_data={
        NAME: ['py.typed', 'report/*.js', 'report/report.*', 'live/static/*', 'export/templates/*']
    },
    data_files=[
        ('share/ament_index/resource_index/packages', [f'resource/{NAME}']),
        (f'share/{NAME}', ['package.xml']),
        (f'share/{NAME}/config', sorted(glob('config/*.*'))),
        (f'share/{NAME}/config/sweeps', sorted(glob('config/sweeps/*.yaml'))),
        (f'share/{NAME}/launch', glob('launch/*.launch.py')),
        *([('bin', ['resource/bin/nadrc'])] if COLCON else []),
    ],
    zip_safe=False,
    install_requires=[
        'setuptools',
        'attrs',
        'matplotlib',
        'numpy',
        'PyYAML',
        'rich',
        'scipy',
        'typer',
    ],
    extras_require={
        'jazzy': ros_wheels('jazzy', rclpy='7.1.6', messages='5.3.6'),
        'kilted': ros_wheels('kilted', rclpy='9.1.2', messages='5.5.1'),
        'speed': ['numba'],
        'sweep': ['dask[distributed]', 'pyarrow'],
        'bags': ['rosbags'],
        'report': REPORT,
        'mujoco': MUJOCO,
        'tune': TUNE,
        'test': [
            'axe-playwright-python',
            'playwright',
            'pytest',
            'pytest-rerunfailures',
            'pytest-xdist',
            'hypothesis',
            *RIVALS,
            *SITE,
            'dask[distributed]',
            'pyarrow',
            'rosbags',
            *REPORT,
            *TUNE,
            *MUJOCO,
            *PAPER,
        ],
        'bench': RIVALS,
        'mutants': ['cosmic-ray>=8,<9'],
        'docs': SITE,
        'lint': [
            'ruff',
            'mypy',
            'types-PyYAML',
            # what ament_flake8 and ament_pep257 run; their wheels do not name it
            'ros-ament-flake8==0.17.3',
            'ros-ament-pep257==0.17.3',
            'pydocstyle',
            'flake8',
            'flake8-blind-except',
            'flake8-builtins',
            'flake8-class-newline',
            'flake8-comprehensions',
            'flake8-deprecated',
            'flake8-docstrings',
            'flake8-import-order',
            'flake8-quotes',
        ],
    },
    entry_points={
        'console_scripts': [f'{PREFIX}{node} = {NAME}.nodes.executables:{node}' for node in NODES]
        + [f'nadrc = {NAME}.cli.__main__:main', f'{PREFIX}live = {NAME}.cli.__main__:live'],
    },
)
