"""Where simulation and road differ, which missing effect causes it, and how far the gap shrinks with it."""
