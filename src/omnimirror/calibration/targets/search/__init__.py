"""Board search: seeds, lattice growth, markers, local rectification, and corner fitting."""
