"""Faults in the manner of SQLite: every call that changes a file fails once in turn, or the process ends at it.

A small library that is preloaded (`preload.c`) counts the writes, renames, fsyncs, openings, closings, new folders and
unlinks below a folder, of Python, Arrow and Rerun alike. One after another fails, a write half done; and at each the
process is stopped while the folder is copied, which holds then what it would hold had the process been killed there.
After each the folder must hold what was there before or what was to be there, never something between, the user must
have been told in one line, and the command comes to its end where it is given again. `make faults` goes through all of
them, `tests/test_faults.py` through some.
"""
