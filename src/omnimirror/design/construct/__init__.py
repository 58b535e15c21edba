"""Construction of mirrors from design parameters: families, mappings and fits."""
