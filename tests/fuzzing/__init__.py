"""Fuzzing: good inputs of every kind, spoilt at random, must be read or refused in a line; nothing else may happen.

`make fuzz` spoils 100,000 of them (`ARGS="count=1000 seed=7 kind=mcap"`), each a function of its number and the seed
alone. What fails is kept in `fuzz-failures/` with the error, and can be tried again by its number. `tests/test_fuzz.py`
takes a fast slice.
"""
