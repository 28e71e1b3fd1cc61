"""Fits car-following models to recorded leader-follower pairs: `jaxcalib fit-following`."""
