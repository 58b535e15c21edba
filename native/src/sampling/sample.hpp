// Conversion of an image in memory to a job, and of a job to tiles for threads.
#pragma once

#include <vector>

#include "job.hpp"

namespace omnimirror {

const Kernels& kernels();            // the selected kernels
bool select_kernels(const char* name);  // false if kernels with this name are not available

// The caller's image: pixels are contiguous; rows are stride bytes apart.
struct Image {
    const uint8_t* data;
    int width, height, channels;
    ptrdiff_t stride;
    Depth depth;
};

// The sampled image, or an edge-replicated copy if it is small.
class SourceImage {
  public:
    SourceImage(const Image& image, Interpolation interpolation);
    const Source& source() const { return source_; }

  private:
    std::vector<uint8_t> copy_;
    Source source_;
};

// The geometry of an image, or of its copy if it is small; the row step is then ignored.
Geometry geometry_of(int width, int height, int channels, int64_t row_step, Interpolation interpolation);

bool is_small(int width, int height);

// Return the states of cells, with inner cells marked. The weights of a pixel sum to 1, and their absolute values to at
// most `reach`.
std::vector<int32_t> states_of(const Lattice& nodes, const Geometry& geometry, float reach);

// Fill the target. Throws std::invalid_argument if the image has too many elements for 31-bit offsets.
void sample(const Job& job);

}  // namespace omnimirror
