#include "footprint_sides.hpp"

#include <algorithm>
#include <cstddef>
#include <vector>

namespace omnimirror {
namespace {

constexpr int SAMPLING_STEP_PX = 4;  // pixels of a patch between evaluated footprints, which change slowly

// Squared length; 0 if NaN.
float squared(float x, float y) {
    const float square = x * x + y * y;
    return square >= 0 ? square : 0;
}

void squares_of_patch(const float* patch, int step, float* out) {
    out[0] = out[1] = 0;
    for (int row = 0; row < step; row += SAMPLING_STEP_PX)
        for (int column = 0; column < step; column += SAMPLING_STEP_PX) {
            const float *here = patch + 2 * (row * step + column), *right = here + 2, *below = here + 2 * step;
            out[0] = std::max(out[0], squared(right[0] - here[0], right[1] - here[1]));
            out[1] = std::max(out[1], squared(below[0] - here[0], below[1] - here[1]));
        }
}

}  // namespace

void squared_sides_of_lattice(const float* x, const float* y, int step, const int32_t* cells, int cell_rows,
                              int cell_columns, const float* patches, float* out) {
    const float scale = 0.5f / static_cast<float>(step);
    const ptrdiff_t columns = cell_columns + 3;
    const auto side = [&](ptrdiff_t node, ptrdiff_t offset) {
        return squared((x[node + offset] - x[node - offset]) * scale, (y[node + offset] - y[node - offset]) * scale);
    };
    // The longest sides at the corners of a row of cells, above and below.
    std::vector<float> above(2 * static_cast<size_t>(cell_columns)), below(above.size());
    const auto corner_sides = [&](int row, std::vector<float>& longest) {
        const ptrdiff_t first = (row + 1) * columns + 1;
        float left[2] = {side(first, 1), side(first, columns)};
        for (int j = 0; j < cell_columns; ++j) {
            const float right[2] = {side(first + j + 1, 1), side(first + j + 1, columns)};
            for (size_t k = 0; k < 2; ++k)
                longest[2 * static_cast<size_t>(j) + k] = std::max(left[k], right[k]), left[k] = right[k];
        }
    };
    corner_sides(0, above);
    for (int i = 0; i < cell_rows; ++i) {
        corner_sides(i + 1, below);
        for (size_t k = 0; k < above.size(); ++k) *out++ = std::max(above[k], below[k]);
        above.swap(below);
    }
    out -= static_cast<ptrdiff_t>(above.size()) * cell_rows;
    const ptrdiff_t count = ptrdiff_t{cell_rows} * cell_columns, size = ptrdiff_t{2} * step * step;
    for (ptrdiff_t i = 0; i < count; ++i)
        if (cells[i] >= 0) squares_of_patch(patches + cells[i] * size, step, out + 2 * i);
}

}  // namespace omnimirror
