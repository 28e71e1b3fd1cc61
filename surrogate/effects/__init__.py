"""Effects that the baseline lacks: one file each, all in one compiled simulator, each off at strength 0."""
