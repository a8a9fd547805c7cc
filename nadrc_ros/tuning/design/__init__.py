"""A first design from requirements: bandwidths by rules, margins and noise by theory."""
