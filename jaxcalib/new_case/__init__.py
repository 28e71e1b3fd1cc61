"""Makes a case of a scenario and logs: what stands in them is taken over, what does not is guessed, and told."""
