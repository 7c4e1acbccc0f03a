"""Somebody's log in, a case in model form out.

Readers (`runner.importing.readers`) know file formats and nothing of models: each yields named signals with the clocks
that they were stamped by. A `map.yaml` (`runner.importing.map_file`) says which signal is which command or channel, in
which unit, by which clock, and where episodes begin; `runner.importing.propose` writes a first one. What the map says
is done in `runner.importing.build`, and `runner.importing.case` writes the folder.
"""
