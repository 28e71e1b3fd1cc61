"""Cases from strangers that want to do harm: write elsewhere, open sockets, fill memory, put markup into reports."""
