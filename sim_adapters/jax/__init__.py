"""The surrogate as an engine: batches of runs, compiled programs kept in files."""
