"""What is kept of runs: recordings, their history, bags, traces to replay, tables of sweeps."""
