"""From an unknown machine to a tuned loop: look, nudge, excite, say, try."""
