#include "deconvolution.hpp"

#include <algorithm>

#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int LINE = 16;  // floats

// Row stride: an odd number of cache lines; otherwise the rows within the reach of a kernel would evict each other.
int64_t stride_of(int64_t columns) { return LINE * (((columns + LINE - 1) / LINE) | 1); }

// Write the columns of the initial image, smoothed so that pixel boundaries do not appear as edges: each value is the
// mean of the pixels that overlap a square of one pixel size centred on it.
void refine(const Deconvolution& s, const float* roots, float* fine) {
    const int f = s.blur.fineness, width = s.blur.width, deep = f * s.blur.height;
    std::vector<float> means(static_cast<size_t>(width) + 2);  // column means, replicated at both ends
    for (int row = 0; row < deep; ++row)
        for (int c = 0; c < s.channels; ++c) {
            std::fill(means.begin(), means.end(), 0.0f);
            float* mean = means.data() + 1;
            for (int n = 0; n < f; ++n) {
                const int line = std::clamp(row + n - f / 2, 0, deep - 1) / f;
                const float* root = roots + int64_t{s.channels} * width * line + c;
                for (int x = 0; x < width; ++x) mean[x] += root[s.channels * x] / static_cast<float>(f * f);
            }
            mean[-1] = mean[0], mean[width] = mean[width - 1];
            for (int within = 0; within < f; ++within)
                for (int n = 0; n < f; ++n) {
                    const float* from = mean + (f + within + n - f / 2) / f - 1;
                    float* out = fine + s.place(row, c, within);
                    for (int x = 0; x < width; ++x) out[x] += from[x];
                }
        }
}

}  // namespace

Deconvolution::Deconvolution(const BlurKernels& blur, int channels, const float* roots, const float* guess)
    : blur(blur), channels(channels), stride(stride_of(blur.width + 1)) {
    const int f = blur.fineness;
    fine.resize(static_cast<size_t>(stride * f * channels * f * blur.height));
    refine(*this, guess, fine.data());
    for (int row = 0; row < f * blur.height; ++row)
        for (int c = 0; c < channels; ++c)
            fine[place(row, c, 0) + blur.width] = fine[place(row, c, f - 1) + blur.width - 1];
    improved = fine;

    const int64_t columns = int64_t{GROUP} * blur.groups();
    observed.assign(static_cast<size_t>(columns * channels * blur.height), -1.0f);
    for (int row = 0; row < blur.height; ++row)
        for (int x = 0; x < blur.width; ++x) {
            const int64_t pixel = int64_t{blur.width} * row + x;
            if (blur.known[static_cast<size_t>(pixel)])
                for (int c = 0; c < channels; ++c)
                    observed[static_cast<size_t>((int64_t{channels} * row + c) * columns + x)] =
                        roots[channels * pixel + c];
        }

    int wide = 0, tall = 0;
    for (const TileBoxes& tile : blur.tiles) {
        wide = std::max(wide, tile.modelled.right - tile.modelled.left);
        tall = std::max(tall, tile.modelled.bottom - tile.modelled.top);
    }
    tile_margin = (blur.reach + GROUP - 1) / GROUP * GROUP + GROUP;
    tile_stride = stride_of(wide + GROUP + 2 * tile_margin);
    tile_rows = f * (tall + 2 * (blur.reach + 1));
    for (const Tap& tap : blur.taps) {
        const int shift = tap.right >= 0 ? tap.right / f : -((f - 1 - tap.right) / f);
        const int64_t place = ((int64_t{channels} * tap.down) * f + tap.right - f * shift) * tile_stride + shift;
        taps.push_back({static_cast<int32_t>(place), tap.weight});
    }
}

Plane Deconvolution::acquire_memory() {
    std::lock_guard lock(mutex_);
    if (memory_.empty()) return {};
    Plane memory = std::move(memory_.back());
    memory_.pop_back();
    return memory;
}

void Deconvolution::release_memory(Plane memory) {
    std::lock_guard lock(mutex_);
    memory_.push_back(std::move(memory));
}

// Uses the instruction set selected for the samplers, or the plain kernel if there is none for it.
const DeconvolutionKernel& deconvolution_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().level >= Level::AVX2) return avx2_deconvolution;
#endif
    return plain_deconvolution;
}

}  // namespace omnimirror
