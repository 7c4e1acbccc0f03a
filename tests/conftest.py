"""Settings for all tests: hypothesis draws the same examples every time and has no deadline on a busy machine."""

from hypothesis import settings

settings.register_profile("project", deadline=None, derandomize=True, max_examples=50)
settings.load_profile("project")
