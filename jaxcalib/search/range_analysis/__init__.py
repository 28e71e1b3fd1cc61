"""Range analysis (Algorithm 2): which parameters matter, and what the range cannot know."""
