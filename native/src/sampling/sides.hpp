// How large the footprints of output pixels are, from the nodes of their coordinates.
#pragma once

#include <cstdint>

namespace omnimirror {

// Squared length of the longest side across and down in every cell, to out (cell rows, cell columns, 2): of a cell that
// is interpolated the largest at its corners of |(p(node + 1) - p(node - 1)) / (2 step)|^2, p = (u, v); of a patch the
// largest difference of neighbours, of every fourth pixel. The nodes are (cell rows + 3, cell columns + 3), the
// others as in Nodes of job.hpp.
void squared_sides_of_nodes(const float* x, const float* y, int step, const int32_t* cells, int cell_rows, int cell_columns,
                      const float* patches, float* out);

}  // namespace omnimirror
