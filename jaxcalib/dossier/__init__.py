"""One document from calibration, validation and diagnosis, for whoever judges whether a test may rest on it."""
