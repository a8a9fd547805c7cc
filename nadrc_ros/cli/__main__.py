"""Lets `python -m nadrc_ros.cli` run from the source tree."""

from nadrc_ros.cli import main

main()
