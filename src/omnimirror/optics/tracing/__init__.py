"""Ray tracing: meridional chief rays, their inversion, and skew rays in space."""
