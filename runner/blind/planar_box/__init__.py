"""Made cases of boxes that are pushed over a floor: their physics, what is planted in them, how they are pushed."""
