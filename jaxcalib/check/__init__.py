"""What can be said of a case before any long work, and the page that shows what was understood."""
