"""Effects: what may differ between a model and the world, one package for each kind of system."""
