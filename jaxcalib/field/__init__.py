"""The logs of drives: tables, even clock, cleaning, and where on the road everything was."""
