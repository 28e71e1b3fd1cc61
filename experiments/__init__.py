"""Studies and examples that run jaxcalib."""
