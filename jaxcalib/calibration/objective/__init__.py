"""What the search minimises: moments, evidence from the logs, and the paper's relative errors."""
