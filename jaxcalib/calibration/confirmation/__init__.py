"""SUMO's word: finalists, the learnt discrepancy, final errors."""
