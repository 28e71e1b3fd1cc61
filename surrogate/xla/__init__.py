"""How arrays of vehicles are worked through fast: tiles, gathers, compaction."""
