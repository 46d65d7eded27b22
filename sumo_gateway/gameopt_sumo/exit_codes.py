"""Exit codes of the commands here; those of `gameopt-vehicles` mean the same."""

from __future__ import annotations

EXIT_FAILED = 1
"""What was asked for went wrong, not what was given."""
EXIT_BAD_INPUT = 2
EXIT_COLLIDED = 4
"""A run went to its end, and vehicles collided."""
