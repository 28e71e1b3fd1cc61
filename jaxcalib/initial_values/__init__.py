"""Where the search begins: driver parameters and inflows that the logs show without any simulation of traffic."""
