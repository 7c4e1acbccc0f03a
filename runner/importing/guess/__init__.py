"""What signals look like: elements of a model, units, clocks, poses. Used to propose a map, never to make a case."""
