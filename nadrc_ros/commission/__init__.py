"""Commissioning on the graph: the machine behind a controller node, rehearsals, the report."""
