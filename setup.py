"""The Python package: built by colcon (`ros2 run nadrc_ros ...`) or by pip (`nadrc ...`)."""

from glob import glob
import sys

from setuptools import find_packages, setup

NAME = 'nadrc_ros'
# What the benches compare with.
RIVALS = ['control==0.10.2', 'pyadrc==0.6.1', 'simple-pid==2.0.1']
# What the site in out/docs is built with.
SITE = ['furo', 'myst-parser', 'sphinx']
# The searches of `nadrc tune`: front, budget, swarm.
TUNE = ['optuna>=5,<6', 'cmaes', 'pymoo']
# The page of `nadrc report`.
REPORT = ['bokeh>=3.7,<4', 'jinja2']
# The machines of examples/mujoco.
MUJOCO = ['mujoco']
# The article of `make paper`.
PAPER = ['jinja2', 'latex2mathml']
NODES = ('controller', 'plant', 'reference', 'recorder')

# colcon calls `setup.py install` or `develop`, and setup.cfg puts the scripts into lib/nadrc_ros.
# pip builds a wheel, whose scripts go into the bin/ that all packages share: there the nodes are
# called nadrc-controller etc.
COLCON = bool({'install', 'develop'} & set(sys.argv))
PREFIX = '' if COLCON else 'nadrc-'

setup(
    name=NAME,
    version='0.1.0',
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
        # ROS 2 Jazzy itself from PyPI, where no ROS is installed: x86-64 Linux only.
        # Without the pin, ros-rclpy would be the one of a later ROS distribution.
        'wheels': [
            'ros-rclpy[fastrtps]==7.1.6',
            'ros-jazzy-rclpy==7.1.6',
            'ros-jazzy-std-msgs==5.3.6',
            'ros-jazzy-std-srvs==5.3.6',
            'ros-jazzy-diagnostic-msgs==5.3.6',
            # what signals are wired to most
            'ros-jazzy-geometry-msgs==5.3.6',
            'ros-jazzy-nav-msgs==5.3.6',
            'ros-jazzy-sensor-msgs==5.3.6',
            'ros-jazzy-trajectory-msgs==5.3.6',
        ],
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
            # what ament_flake8 and ament_pep257 of Jazzy run; their wheels do not name it
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
