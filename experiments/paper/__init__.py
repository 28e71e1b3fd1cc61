"""The paper's evaluation: its methods side by side, its figures and its numbers, on any case."""
