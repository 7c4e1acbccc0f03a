"""Any mechanism given as MJCF and a log, in the model form of a recording."""

from runner.systems.mechanism.system import MechanismSystem, read_mechanism

__all__ = ["MechanismSystem", "read_mechanism"]
