"""Car-following models, one file each."""
