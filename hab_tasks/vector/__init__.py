"""Native vector environments: many CPU simulations in few processes."""
