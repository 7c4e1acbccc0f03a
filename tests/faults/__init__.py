"""Faults in the manner of SQLite: every call that changes a file fails once in turn, or ends the process.

A small library that is preloaded (`preload.c`) counts the writes, renames, fsyncs, openings, closings, new folders and
unlinks below a folder, of Python, Arrow and Rerun alike, and makes one of them fail: a write half done, a rename not at
all. After each the folder must hold what was there before or what was to be there, never something between, and the
user must have been told in one line. `make faults` goes through all of them, `tests/test_faults.py` through some.
"""
