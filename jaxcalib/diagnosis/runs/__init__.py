"""The runs that a diagnosis needs, in both simulators."""
