// Taking a known blur out of a picture, as omnimirror.simulate.restoration.sharp_picture has it: the same formulas and
// steps.
//
// The sharp picture lies on a grid `fineness` times as fine as the pixels.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

namespace omnimirror {

constexpr int RUN_LANES = 8;  // weights of a run are filled up with zeros to a multiple of it

// Adjoining values of the fine grid that count in a pixel, and where their weights begin.
struct Run {
    int32_t down, right, count, weight;
};

struct Span {
    int32_t begin, end;
};

// A pixel that is known, and where it stands in the caller's list.
struct Visit {
    int32_t row, column, kernel, listed;
};

// Some of the visits, of pixels in a part of the picture. Kernels of patches of one colour do not reach each other.
struct Patch {
    int32_t begin, end;
};
constexpr int COLOURS = 4;

struct BlurKernels {
    int width, height, fineness;      // of the picture; pixels of the fine grid along the side of a pixel
    std::vector<int32_t> first_runs;  // (kernels + 1)
    std::vector<Run> runs;
    std::vector<float> weights;
    std::vector<Span> spans;          // columns of each row of the fine grid that some pixel depends on
    std::vector<Visit> visits;        // all pixels, patch by patch
    std::vector<Patch> patches;
    int first_patches[COLOURS + 1];     // of each colour
    // of all kernels: how far they reach on the fine grid, from the first value of their pixel
    int least_down, most_down, least_right, most_right;

    int across() const { return width * fineness; }
    int deep() const { return height * fineness; }
};

// The order in which to visit `pixels`, row * width + column, ascending.
void arrange(BlurKernels& blur, const int32_t* pixels, const int32_t* kernels, int64_t count);

// A sharp picture that is looked for, and what conjugate gradients keep. Only what lies in the spans changes.
//
// Planes have a row of each channel after the other, with room at both ends: (row * channels + channel) * stride. The
// stride is an odd number of cache lines, or the rows that a kernel reaches would push each other out.
class Sharpening {
  public:
    static constexpr int ROOM = 16;

    Sharpening(const BlurKernels& blur, int channels, const float* roots);

    const BlurKernels& blur;
    const int channels;
    const int64_t stride;

  private:
    struct Free {
        void operator()(void* memory) const;
    };
    std::unique_ptr<float, Free> memory_;  // zeros, of which only what is used takes room

  public:
    float *fine, *d, *product, *image, *x, *residual;  // planes; the image is fine^2, or fine d
    float* stiffness;                                  // a row of one channel
    float *seen, *slope2;                              // (channels, visits)
    std::vector<double> sums;                          // of the rows
};

// What each instruction set implements, in a translation unit of its own.
struct SharpeningKernel {
    // A round of the picture's improvement, with costs (height, width) of steepness and so many steps.
    void (*improve)(Sharpening&, const float* costs, int steps);
    // Mean logarithms (height, width) of the steepness in every pixel.
    void (*log_steepness)(const Sharpening&, float* logarithms);
    // Light (pixels, channels) of the blurred picture.
    void (*blurred)(Sharpening&, float* light);
    // Light (height, width, channels) of the sharp one.
    void (*light)(const Sharpening&, float* light);
};

extern const SharpeningKernel plain_sharpening;
extern const SharpeningKernel avx2_sharpening;

const SharpeningKernel& sharpening_kernel();  // that of the instructions in use

}  // namespace omnimirror
