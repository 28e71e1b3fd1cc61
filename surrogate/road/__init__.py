"""The road and the vehicles on it, and what the subject vehicle perceives of them."""
