"""Whether the quantities of a log obey physics and agree with one another, before any of them is believed."""
