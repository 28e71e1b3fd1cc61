"""The stages of a diagnosis, in order, each from one frozen record to the next."""
