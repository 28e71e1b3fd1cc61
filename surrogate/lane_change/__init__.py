"""Lane changing: what the route demands, what drivers wish, which gaps they accept, how they make room."""
