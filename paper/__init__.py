"""The paper, reproduced: what it claims beside what this package measures."""
