"""Makes cases of recordings in other formats: drives of automated vehicles, and traffic seen from above."""
