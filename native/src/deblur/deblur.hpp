// Taking a known blur out of a picture, as omnimirror.simulate.restoration.operators has it: the same formulas and steps.
//
// The sharp picture lies on a grid `fineness` times as fine as the pixels. Values adjoin as (row, column, channel);
// there are 1 or 4 channels.
#pragma once

#include <cstdint>
#include <vector>

namespace omnimirror {

// Adjoining values of the fine grid that count in a pixel, and where their weights begin.
struct Run {
    int32_t down, right, count, weight;
};

struct BlurKernels {
    int width, height, fineness;      // of the picture; pixels of the fine grid along the side of a pixel
    std::vector<int32_t> first_runs;  // (kernels + 1)
    std::vector<Run> runs;
    std::vector<float> weights;
    std::vector<int32_t> pixels, kernels;  // row * width + column, ascending, and the kernel of each
    // of all kernels: how far they reach on the fine grid, from the first value of their pixel
    int least_down, most_down, least_right, most_right;
};

// Values of the fine grid, blurred to those of the pixels (pixels, channels).
void blur(const BlurKernels& kernels, int channels, const float* fine, float* blurred);

// The transpose: what each value of the fine grid contributes to.
void spread(const BlurKernels& kernels, int channels, const float* blurred, float* fine);

// The second derivative of the problem about `fine`, times d: fine A^T slope2 A fine d, and the smoothness, whose
// stiffness is one for all channels. Returns the scalar product of d with it. `scratch` holds values of the pixels.
struct Curvature {
    const BlurKernels& kernels;
    int channels;
    const float *fine, *slope2, *stiffness;
};
double times(const Curvature& curvature, const float* d, float* product, float* scratch);

// x += step d, residual -= step product; returns the scalar product of the residual with itself scaled.
double advance(int64_t places, int channels, float step, const float* d, const float* product, const float* scale,
               float* x, float* residual);

// d = scale residual + share d
void turn(int64_t places, int channels, float share, const float* scale, const float* residual, float* d);

}  // namespace omnimirror
