"""What a vehicle is: its class, its limits, and what its two driver models answer."""
