"""What was measured: a JSON file per study, and the Markdown that `python -m experiments.results` makes of it."""
