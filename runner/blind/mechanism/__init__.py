"""Made cases of mechanisms: their physics, what is planted in them, how they are driven, and their MJCF."""
