"""Blind tests: recordings with withheld effects, made by a second physics that the diagnosis never sees."""
