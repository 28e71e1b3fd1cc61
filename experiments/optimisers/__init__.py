"""Which optimiser finds the best parameters for how many simulations: one interface, many optimisers, one study."""
