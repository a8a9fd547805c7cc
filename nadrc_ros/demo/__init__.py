"""A scenario as processes on the graph: what is launched, and what an operator does meanwhile."""
