// Footprint sizes of output pixels, from the nodes of their coordinates.
#pragma once

#include <cstdint>

namespace omnimirror {

// Compute the squared length of the longest side across and down in every cell, and write it to out (cell rows, cell
// columns, 2). Interpolated cells: the maximum over their corners of |(p(node + 1) - p(node - 1)) / (2 step)|^2, p =
// (u, v). Patches: the largest squared difference of neighbours, evaluated at every fourth pixel. The nodes are (cell
// rows + 3, cell columns + 3), the other arguments as in Lattice of job.hpp.
void squared_sides_of_lattice(const float* x, const float* y, int step, const int32_t* cells, int cell_rows,
                              int cell_columns, const float* patches, float* out);

}  // namespace omnimirror
