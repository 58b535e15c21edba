// Taking a known blur out of a picture, as omnimirror.dewarp.restoration.sharp_picture has it: the same formulas and
// steps.
//
// The sharp picture lies on a grid `fineness` times as fine as the pixels. Pixels are blurred in groups of eight beside
// each other: as many as a block has, or all, have one kernel, and columns of the fine grid are kept apart by their
// place within the pixel (a row of the first ones, a row of the next), so that their values lie together. A round
// improves tile by tile, each as a picture of its own in memory that stays in the processor's caches.
#pragma once

#include <cstdint>
#include <mutex>
#include <vector>

#include "large_pages.hpp"

namespace omnimirror {

constexpr int GROUP = 8;  // adjoining pixels of a row that are blurred beside each other

struct Box {  // of pixels, without the last row and column
    int32_t top, bottom, left, right;

    Box moved(int down, int right_) const { return {top + down, bottom + down, left + right_, right + right_}; }
};

// A part of the picture, as Blur.tiles of blurring.py has them.
struct Part {
    Box kept, explained, values;
};

// A value of the fine grid that counts in a pixel: where it lies from the first one of that.
struct Tap {
    int32_t down, right;
    float weight;
};

struct BlurKernels {
    int width, height, fineness;      // of the picture; values of the fine grid along the side of a pixel
    std::vector<int32_t> first_taps;  // (kernels + 1), even: pairs are filled up with what weighs nothing
    std::vector<Tap> taps;
    int block;                     // adjoining pixels of a row that have one kernel: 1, 2, 4 or 8
    std::vector<int32_t> kernels;  // (height, groups * GROUP / block), or -1 where nothing is known
    std::vector<uint8_t> known;    // (height, width)
    std::vector<Part> tiles;
    std::vector<float> concentration;  // (height, width) of the weights in each pixel's kernel
    int reach;                         // pixels that kernels go beyond their own, at most

    int groups() const { return (width + GROUP - 1) / GROUP; }
};

using Plane = std::vector<float, LargePages<float>>;

// A tap by the distance of its value in a tile's planes.
struct PlacedTap {
    int32_t place;
    float weight;
};

// A sharp picture that is looked for.
class Sharpening {
  public:
    // Of a blurred picture of such roots (height, width, channels), begun at a guess of the sharp one's.
    Sharpening(const BlurKernels& blur, int channels, const float* roots, const float* guess);

    // Where values begin of a row of the fine grid, of a channel, and of one of the columns within the pixels.
    int64_t place(int row, int channel, int within) const {
        return ((int64_t{channels} * row + channel) * blur.fineness + within) * stride;
    }

    const BlurKernels& blur;
    const int channels;
    const int64_t stride;
    Plane fine, improved;  // roots of its light, before and after a round; a column is repeated on the right
    Plane seen;            // (height, channels, groups * GROUP) of the blurred one, below 0 where nothing is known

    // Planes of tiles have as many columns of pixels on both sides of those that are explained, and of rows one more
    // than kernels reach.
    int64_t tile_stride;
    int tile_rows, tile_margin;
    std::vector<PlacedTap> taps;

    Plane lend_memory();
    void give_back(Plane memory);

  private:
    std::mutex mutex_;
    std::vector<Plane> memory_;  // of tiles, for those who come next
};

// What each instruction set implements, in a translation unit of its own.
struct SharpeningKernel {
    // A round of the picture's improvement, with costs (height, width) of steepness and so many steps (tiles); where
    // they are 0 a tile stays as it is.
    void (*improve)(Sharpening&, const float* costs, const int32_t* steps);
    // Mean logarithms (height, width) of the steepness in every pixel.
    void (*log_steepness)(const Sharpening&, float* logarithms);
    // Light (height, width, channels) of the blurred picture, where it is known.
    void (*blurred)(Sharpening&, float* light);
    // Light (height, width, channels) of the sharp one.
    void (*light)(const Sharpening&, float* light);
};

extern const SharpeningKernel plain_sharpening;
extern const SharpeningKernel avx2_sharpening;

const SharpeningKernel& sharpening_kernel();  // that of the instructions in use

}  // namespace omnimirror
