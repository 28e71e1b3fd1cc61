"""Statistics that several parts of the program share."""
