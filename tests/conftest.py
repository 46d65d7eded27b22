"""How much the property tests try: the same cases every time in the gate, new ones with `make explore`."""

from hypothesis import settings

# The gate has to say the same of the same commit; searching for new counterexamples is its own command.
settings.register_profile("gate", derandomize=True, deadline=None)
settings.register_profile("explore", max_examples=2000, deadline=None, print_blob=True)
settings.load_profile("gate")
