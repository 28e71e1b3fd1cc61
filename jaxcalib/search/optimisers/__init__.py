"""Optimisers behind the one interface, a file each; `registry` lists them."""
