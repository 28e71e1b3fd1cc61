"""Cases whose files are spoilt by a grammar of mutations, drawn by a seed."""
