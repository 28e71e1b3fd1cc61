"""Who enters where and when."""
