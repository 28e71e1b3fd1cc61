"""Pages and figures for people: one file each, without scripts or anything from outside."""
