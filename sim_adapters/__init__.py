"""One question, two engines: the surrogate and SUMO answer the same requests with the same observations."""
