"""The answer and its report."""
