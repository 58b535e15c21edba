"""Form errors of mirrors: those that were measured, those that a power spectrum foretells, and what they do."""
