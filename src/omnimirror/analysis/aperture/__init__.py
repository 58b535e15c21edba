"""What the whole aperture does: bundles of real rays, spots, point spread, transfer of contrast, light."""
