"""What the program survives: kills, spoilt files, workers and disks that fail, strangers' cases, long use."""
