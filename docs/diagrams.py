"""Writes the block diagrams of docs/paper.md: `python docs/diagrams.py`."""

from __future__ import annotations

from pathlib import Path

from nadrc_ros.paper.diagrams import c_adrc, n_adrc

HERE = Path(__file__).parent
DIAGRAMS = {HERE / 'c_adrc.svg': c_adrc, HERE / 'n_adrc.svg': n_adrc}

if __name__ == '__main__':
    for path, draw in DIAGRAMS.items():
        path.write_text(draw(), encoding='utf-8')
