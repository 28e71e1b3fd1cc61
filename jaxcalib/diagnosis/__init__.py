"""Diagnosis of the gap between simulation and road: where it lies, which missing effect causes it, how far it shrinks."""
