#include "deblur.hpp"

#include <algorithm>
#include <cstdlib>
#include <new>

#include "sampling/sample.hpp"

namespace omnimirror {
namespace {

constexpr int LINE = 16;  // floats

int64_t stride_of(int across) { return int64_t{LINE} * (((across + LINE - 1) / LINE + 2 * Sharpening::ROOM / LINE) | 1); }

// Patches whose windows lie in the first cache, unless kernels are larger.
constexpr int PATCH_ROWS = 16, PATCH_COLUMNS = 32;
// Places of a row that are visited in turn: what the last pixel stored is on its way, and loading it has to wait.
constexpr int PLACES = 4;

}  // namespace

void arrange(BlurKernels& blur, const int32_t* pixels, const int32_t* kernels, int64_t count) {
    const int down = std::max(blur.most_down, -blur.least_down), right = std::max(blur.most_right, -blur.least_right);
    const int rows = std::max(PATCH_ROWS, 2 * down / blur.fineness + 2);
    const int columns = std::max(PATCH_COLUMNS, (2 * right + RUN_LANES) / blur.fineness + 2);
    for (int colour = 0; colour < COLOURS; ++colour) {
        blur.first_patches[colour] = static_cast<int>(blur.patches.size());
        for (int top = rows * (colour / 2); top < blur.height; top += 2 * rows)
            for (int left = columns * (colour % 2); left < blur.width; left += 2 * columns) {
                const auto begin = static_cast<int32_t>(blur.visits.size());
                for (int row = top; row < std::min(top + rows, blur.height); ++row) {
                    const int32_t* first = std::lower_bound(pixels, pixels + count, row * blur.width + left);
                    const int32_t* end = std::lower_bound(
                        first, pixels + count, row * blur.width + std::min(left + columns, blur.width));
                    const int64_t part = (end - first + PLACES - 1) / PLACES;
                    for (int64_t n = 0; n < part; ++n)
                        for (const int32_t* pixel = first + n; pixel < end; pixel += part)
                            blur.visits.push_back({row, *pixel - row * blur.width, kernels[pixel - pixels],
                                                   static_cast<int32_t>(pixel - pixels)});
                }
                const auto end = static_cast<int32_t>(blur.visits.size());
                if (end > begin) blur.patches.push_back({begin, end});
            }
    }
    blur.first_patches[COLOURS] = static_cast<int>(blur.patches.size());
}

void Sharpening::Free::operator()(void* memory) const { std::free(memory); }

Sharpening::Sharpening(const BlurKernels& blur, int channels, const float* roots)
    : blur(blur), channels(channels), stride(stride_of(blur.across())), sums(static_cast<size_t>(blur.deep())) {
    const int64_t plane = stride * channels * blur.deep(), pixels = static_cast<int64_t>(blur.visits.size());
    const int64_t size = 6 * plane + stride * blur.deep() + 2 * channels * pixels + 2 * ROOM;
    memory_.reset(static_cast<float*>(std::calloc(static_cast<size_t>(size), sizeof(float))));
    if (!memory_) throw std::bad_alloc();
    float* next = memory_.get() + ROOM;
    for (float** array : {&fine, &d, &product, &image, &x, &residual}) *array = next, next += plane;
    stiffness = next, next += stride * blur.deep();
    seen = next, slope2 = next + channels * pixels;
    for (int64_t i = 0; i < pixels; ++i) {
        const Visit& visit = blur.visits[static_cast<size_t>(i)];
        const float* values = roots + channels * (int64_t{blur.width} * visit.row + visit.column);
        for (int c = 0; c < channels; ++c) seen[c * pixels + i] = values[c];
    }
    // without the stairs of pixels, which would be taken for edges
    const int f = blur.fineness;
    std::vector<int> columns(static_cast<size_t>(blur.across() + f));
    for (int i = 0; i < blur.across() + f; ++i) columns[static_cast<size_t>(i)] = std::clamp(i - f / 2, 0, blur.across() - 1) / f * channels;
    std::vector<float> mean(static_cast<size_t>(blur.width * channels));
    for (int row = 0; row < blur.deep(); ++row) {
        std::fill(mean.begin(), mean.end(), 0.0f);
        for (int n = 0; n < f; ++n) {
            const float* line = roots + int64_t{channels} * blur.width * (std::clamp(row + n - f / 2, 0, blur.deep() - 1) / f);
            for (size_t i = 0; i < mean.size(); ++i) mean[i] += line[i] / static_cast<float>(f * f);
        }
        for (int c = 0; c < channels; ++c) {
            float* out = fine + (int64_t{channels} * row + c) * stride;
            for (int n = 0; n < f; ++n)
                for (int i = 0; i < blur.across(); ++i) out[i] += mean[static_cast<size_t>(columns[static_cast<size_t>(i + n)] + c)];
            out[blur.across()] = out[blur.across() - 1];  // beyond the picture its values go on
        }
    }
}

// The samplers choose the instructions; those without a kernel here take the plain one.
const SharpeningKernel& sharpening_kernel() {
#if defined(OMNIMIRROR_AVX2)
    if (kernels().has_avx2) return avx2_sharpening;
#endif
    return plain_sharpening;
}

}  // namespace omnimirror
