"""File formats of Scaramuzza's polynomial model."""
