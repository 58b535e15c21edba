// From a picture in memory to a job, and from a job to tiles on threads.
#pragma once

#include <vector>

#include "job.hpp"

namespace omnimirror {

const Kernels& kernels();            // those in use
bool use_kernels(const char* name);  // false where this machine has none of that name

// A picture as the caller has it: pixels adjoin, rows are stride bytes apart.
struct Picture {
    const uint8_t* data;
    int width, height, channels;
    ptrdiff_t stride;
    Depth depth;
};

// What is sampled: the picture, or a copy of a small one with its edge repeated.
class Sampled {
  public:
    Sampled(const Picture& picture, Interpolation interpolation);
    const Source& source() const { return source_; }

  private:
    std::vector<uint8_t> copy_;
    Source source_;
};

// The geometry of a picture, or of its copy if it is small, in which case the row step does not matter.
Geometry geometry_of(int width, int height, int channels, int64_t row_step, Interpolation interpolation);

bool is_small(int width, int height);

// The states of cells, with those marked that are inner ones. The weights of a pixel, whose sum is 1, have at most the sum
// `reach` without their signs.
std::vector<int32_t> states_of(const Nodes& nodes, const Geometry& geometry, float reach);

// Fill the target; throws std::invalid_argument where the picture has too many elements for offsets of 31 bits.
void sample(const Job& job);

}  // namespace omnimirror
