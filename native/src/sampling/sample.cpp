#include "sample.hpp"

#include <algorithm>
#include <atomic>
#include <cstring>
#include <stdexcept>
#include <string>

#include "cpu.hpp"
#include "pool.hpp"

namespace omnimirror {
namespace {

std::atomic<const Kernels*> active_kernels{nullptr};

// Copy of a small image, with its edge replicated to the right and below.
std::vector<uint8_t> enlarged(const Image& p, int width, int height) {
    const size_t pixel = static_cast<size_t>(p.channels * size_of(p.depth));
    std::vector<uint8_t> copy(pixel * static_cast<size_t>(width) * static_cast<size_t>(height));
    for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
            std::memcpy(
                copy.data() + pixel * (static_cast<size_t>(y) * static_cast<size_t>(width) + static_cast<size_t>(x)),
                p.data + std::min(y, p.height - 1) * p.stride +
                    static_cast<ptrdiff_t>(pixel) * std::min(x, p.width - 1),
                pixel);
    return copy;
}

// Each thread processes a band of whole rows, because threads that write to the same cache line slow each other down.
// Within a band it proceeds panel by panel; the first rows of a panel are not prefetched. Bands are therefore as high
// as possible, but numerous enough to balance the load if some threads are delayed.
constexpr int MAX_BAND_HEIGHT = 256, MIN_BAND_HEIGHT = 4, BANDS_PER_THREAD = 4;

int band_height(int rows) {
    const int threads = get_threads();
    const int shared = threads > 1 ? rows / (threads * BANDS_PER_THREAD) : rows;
    return std::clamp(shared, MIN_BAND_HEIGHT, MAX_BAND_HEIGHT);
}

struct Work {
    const Job& job;
    const Kernels& kernels;
    int band;
};

void sample_band(void* context, int index) {
    const Work& work = *static_cast<const Work*>(context);
    const Target& target = work.job.target;
    const int top = index * work.band, bottom = std::min(top + work.band, target.height);
    const auto fill = work.job.footprints.taps ? work.kernels.average : work.kernels.sample;
    for (int left = 0; left < target.width; left += PANEL)
        fill(work.job, {top, bottom, left, std::min(left + PANEL, target.width)});
}

}  // namespace

const Kernels& kernels() {
    const Kernels* selected = active_kernels;
    if (!selected) active_kernels = selected = best_kernels();
    return *selected;
}

bool select_kernels(const char* name) {
    const Kernels* selected = kernels_named(name);
    if (selected) active_kernels = selected;
    return selected;
}

bool is_small(int width, int height) { return width < MIN_SIDE || height < MIN_SIDE; }

Geometry geometry_of(int width, int height, int channels, int64_t row_step, Interpolation interpolation) {
    int last_x = width - 1, last_y = height - 1;
    if (is_small(width, height)) {
        last_x += MIN_SIDE, last_y += MIN_SIDE;
        row_step = int64_t{last_x + 1} * channels;
    }
    const int64_t elements = row_step * (last_y + 1);
    if (elements > MAX_ELEMENT_OFFSET)
        throw std::invalid_argument("the image must have at most " + std::to_string(MAX_ELEMENT_OFFSET) +
                                    " values, including gaps between rows; got " + std::to_string(elements));
    Geometry g{};
    g.width = width, g.height = height;
    const int margin = interpolation == Interpolation::nearest ? 0 : 1;
    g.x0_max = last_x - margin, g.y0_max = last_y - margin;
    g.pixel_step = static_cast<uint32_t>(channels), g.row_step = static_cast<uint32_t>(row_step);
    g.x_inner = g.y_inner = 1;
    g.x_span = static_cast<uint32_t>(last_x - 3), g.y_span = static_cast<uint32_t>(last_y - 3);
    return g;
}

SourceImage::SourceImage(const Image& p, Interpolation interpolation) {
    source_.depth = p.depth, source_.channels = p.channels;
    source_.geometry = geometry_of(p.width, p.height, p.channels, p.stride / size_of(p.depth), interpolation);
    source_.data = p.data;
    source_.elements = int64_t{source_.geometry.row_step} * (p.height - 1) + int64_t{p.width} * p.channels;
    if (is_small(p.width, p.height)) {
        copy_ = enlarged(p, p.width + MIN_SIDE, p.height + MIN_SIDE);
        source_.data = copy_.data();
        source_.elements = static_cast<int64_t>(copy_.size()) / size_of(p.depth);
    }
}

namespace {

// Mark cells that may reach within 2 pixels of a side of the image, or beyond it. Interpolation with weights whose sum
// is 1 and whose absolute values sum to r exceeds the range of the nodes by at most (r - 1)/2 times this range; by 9/32
// for Lagrange weights.
void mark_outer(const float* nodes, const Lattice& n, int size, float margin, std::vector<int32_t>& states) {
    std::vector<float> minimum(static_cast<size_t>(n.columns)), maximum(minimum);
    for (int row = 0; row + 3 < n.rows; ++row) {
        const float* first = nodes + static_cast<ptrdiff_t>(row) * n.columns;
        for (int i = 0; i < n.columns; ++i) {
            const float* node = first + i;
            const float a = node[0], b = node[n.columns];
            const float c = node[2 * n.columns], d = node[3 * n.columns];
            // std::min would drop NaN: odd is 0 if all four values are finite, otherwise NaN.
            const float odd = (a - a) + (b - b) + (c - c) + (d - d);
            minimum[static_cast<size_t>(i)] = std::min(std::min(a, b), std::min(c, d)) + odd;
            maximum[static_cast<size_t>(i)] = std::max(std::max(a, b), std::max(c, d)) + odd;
        }
        for (int i = 0; i < n.cell_columns; ++i) {
            const float *l = minimum.data() + i, *m = maximum.data() + i;
            const float odd = (l[0] - l[0]) + (l[1] - l[1]) + (l[2] - l[2]) + (l[3] - l[3]);
            const float low = std::min(std::min(l[0], l[1]), std::min(l[2], l[3])) + odd;
            const float high = std::max(std::max(m[0], m[1]), std::max(m[2], m[3])) + odd;
            const float more = margin * (high - low);
            int32_t& state = states[static_cast<size_t>(row) * static_cast<size_t>(n.cell_columns) + static_cast<size_t>(i)];
            const bool inner = low - more >= 2 && high + more <= static_cast<float>(size - 3);
            if (state == INNER && !inner) state = INTERPOLATED;
        }
    }
}

}  // namespace

std::vector<int32_t> states_of(const Lattice& n, const Geometry& g, float reach) {
    std::vector<int32_t> states(n.cells, n.cells + static_cast<ptrdiff_t>(n.rows - 3) * n.cell_columns);
    for (int32_t& state : states)
        if (state < 0) state = INNER;
    const float margin = std::max(0.3f, 0.51f * (reach - 1));  // slightly increased, for rounding
    mark_outer(n.x, n, g.width, margin, states);
    mark_outer(n.y, n, g.height, margin, states);
    return states;
}

void sample(const Job& job) {
    Work work{job, kernels(), band_height(job.target.height)};
    parallel_for((job.target.height + work.band - 1) / work.band, &sample_band, &work);
}

}  // namespace omnimirror
