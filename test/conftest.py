"""For all tests: how long a property takes is not tested; machines are busy, and numba compiles."""

from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
