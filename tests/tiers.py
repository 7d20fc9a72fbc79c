"""The tiers of tests, as expressions for ``-m``."""

SHORT = "not full and not campaign"
"""Without ``-m``."""

FILES = "not campaign"
"""Without ``-m``, where files are named."""

FULL = "full and not campaign"
"""With ``-m full``: a file may be full, and some of its tests campaigns."""
