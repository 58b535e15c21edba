// Deconvolution of an image with a known blur, with the formulas and steps of
// src/omnimirror/dewarp/restoration/_deconvolution.py.
//
// The sharp image is defined on a grid `fineness` times as fine as the pixels. Pixels are blurred in groups of
// eight adjacent ones, in which all pixels of a block (up to the whole group) share one kernel. Columns of the fine
// grid are stored by their position within the pixel (a row of the first columns, then a row of the second ones), so
// that the values of a group are contiguous. A round processes the image tile by tile; each tile is a separate image
// that fits into the CPU caches.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "large_pages.hpp"

namespace omnimirror {

constexpr int GROUP = 8;  // adjacent pixels of a row that are blurred together

struct Box {  // of pixels; bottom and right are exclusive
    int32_t top, bottom, left, right;

    Box moved(int down, int right_) const { return {top + down, bottom + down, left + right_, right + right_}; }
};

// A tile of the image, as in Blur.tiles of dewarp/restoration/blur_model.py.
struct TileBoxes {
    Box core, modelled, values;
};

// A value of the fine grid that contributes to a pixel: its offset from the first value of that pixel.
struct Tap {
    int32_t down, right;
    float weight;
};

struct BlurKernels {
    int width, height, fineness;  // of the image; fineness: values of the fine grid per pixel side
    std::vector<int32_t> first_taps;  // (kernels + 1), even: padded with zero weights
    std::vector<Tap> taps;
    int block;                     // adjacent pixels of a row that share one kernel: 1, 2, 4 or 8
    std::vector<int32_t> kernels;  // (height, groups * GROUP / block); -1 without known pixels
    std::vector<uint8_t> known;    // (height, width)
    std::vector<TileBoxes> tiles;
    std::vector<float> concentration;  // (height, width), of the weights in the kernel of each pixel
    int reach;                         // maximum extent of kernels beyond their pixel, px

    int groups() const { return (width + GROUP - 1) / GROUP; }
};

using Plane = std::vector<float, LargePages<float>>;

// A tap, with the offset of its value in the planes of a tile.
struct PlacedTap {
    int32_t place;
    float weight;
};

// State of a deconvolution.
class Deconvolution {
  public:
    // From a blurred image, given by its square roots (height, width, channels), and an initial guess of the roots of
    // the sharp image.
    Deconvolution(const BlurKernels& blur, int channels, const float* roots, const float* guess);

    // Index of the first value of a row of the fine grid, a channel, and a column position within the pixels.
    int64_t place(int row, int channel, int within) const {
        return ((int64_t{channels} * row + channel) * blur.fineness + within) * stride;
    }

    const BlurKernels& blur;
    const int channels;
    const int64_t stride;
    Plane fine, improved;  // square roots of radiance, before and after a round; one column is repeated on the right
    Plane observed;        // (height, channels, groups * GROUP) of the blurred image; below 0: unknown

    // The planes of tiles have margins around the explained pixels: the reach of the kernels on both sides in columns,
    // and one more in rows.
    int64_t tile_stride;
    int tile_rows, tile_margin;
    std::vector<PlacedTap> taps;

    Plane acquire_memory();
    void release_memory(Plane memory);

  private:
    std::mutex mutex_;
    std::vector<Plane> memory_;  // memory of tiles, for reuse
};

// Kernels of one instruction set, implemented in a separate translation unit.
struct DeconvolutionKernel {
    // One round of improvement. costs (height, width) are the weights of the gradients; steps (tiles) are numbers of
    // steps, where 0 leaves a tile unchanged.
    void (*improve)(Deconvolution&, const float* costs, const int32_t* steps);
    // Mean logarithms (height, width) of the gradient magnitude in each pixel.
    void (*log_steepness)(const Deconvolution&, float* logarithms);
    // Radiance (height, width, channels) of the blurred image at known pixels.
    void (*blurred)(Deconvolution&, float* light);
    // Radiance (height, width, channels) of the sharp image.
    void (*light)(const Deconvolution&, float* light);
};

extern const DeconvolutionKernel plain_deconvolution;
extern const DeconvolutionKernel avx2_deconvolution;

const DeconvolutionKernel& deconvolution_kernel();  // the kernel of the selected instruction set

}  // namespace omnimirror
