"""Recordings spoilt in one way after another, and what is said of each.

`python -m tests.corruptions` prints a table of all, `python -m tests.corruptions sound FOLDER ...` what is warned of in
recordings that are sound.
"""
