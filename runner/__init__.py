"""Headless experiments on simulated and recorded objects, and a diagnosis of the gap between the two."""
