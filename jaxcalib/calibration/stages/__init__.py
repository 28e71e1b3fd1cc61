"""The stages of the search: demand, screening, driver parameters, refinement; all in the surrogate."""
