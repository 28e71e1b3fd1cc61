"""Roads on which studies make their cases: known ones, and ones drawn at random."""
