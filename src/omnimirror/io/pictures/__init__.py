"""Picture files, and what they carry beside pixels."""
