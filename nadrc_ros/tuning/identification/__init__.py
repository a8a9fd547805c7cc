"""The plant behind a log: order, input gain with its interval, noise, lateness."""
