"""A tolerance instead of a duration: realizations, and pairs of whole runs at two steps, which tell the bias."""
