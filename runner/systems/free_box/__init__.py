"""A box in space: what a recording in the form in space is about, as a mechanism of one free body."""

from runner.systems.free_box.system import free_box

__all__ = ["free_box"]
