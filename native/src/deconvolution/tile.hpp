// Working memory and blur of a tile. Everything has internal linkage, as in kernel.hpp.
#pragma once

#include <algorithm>
#include <cstring>

#include "deconvolution.hpp"

namespace omnimirror {
namespace {

template <int N>
struct Vector {  // GCC loses the vector size if the type itself is an alias
    typedef float Lanes __attribute__((vector_size(4 * N)));
};

template <class T>
inline T load(const float* from) {
    T lanes;
    std::memcpy(&lanes, from, sizeof lanes);
    return lanes;
}

template <class T>
inline void store(float* to, T lanes) {
    std::memcpy(to, &lanes, sizeof lanes);
}

// A loop over columns, which compilers vectorise.
#if defined(__GNUC__) && !defined(__clang__)
#define OMNIMIRROR_COLUMNS(x, box) _Pragma("GCC ivdep") for (int x = (box).left; x < (box).right; ++x)
#else
#define OMNIMIRROR_COLUMNS(x, box) for (int x = (box).left; x < (box).right; ++x)
#endif

// Inner loops are separate functions, in which all pointers fit into registers.
#define OMNIMIRROR_NOINLINE __attribute__((noinline))

// -- a tile ------------------------------------------------------------------------------------------------

// Working memory of a tile: its planes, and its boxes in them. Rows are those of the fine grid, columns those of
// pixels. Planes of all channels have a row for each channel and position within the pixel; other planes have one for
// each position.
template <int C>
struct Work {
    Deconvolution& s;
    const TileBoxes& tile;
    const int f, reach, top, left;  // the pixel of the image at which the planes start
    const int64_t stride;
    const Box modelled, values;
    const bool is_clipped_left, is_clipped_right;  // the tile is at an edge of the image, and kernels extend beyond it
    Plane memory;
    float *fine, *d, *product, *image, *x, *residual;  // image = fine^2, or fine d
    float *stiffness, *scale;
    float* slope2;  // (rows of pixels, C)

    Work(Deconvolution& sharpening, const TileBoxes& part)
        : s(sharpening),
          tile(part),
          f(s.blur.fineness),
          reach(s.blur.reach),
          top(part.modelled.top - reach - 1),
          left(part.modelled.left - s.tile_margin),
          stride(s.tile_stride),
          modelled(part.modelled.moved(-top, -left)),
          values(part.values.moved(-top, -left)),
          is_clipped_left(values.left > modelled.left - reach),
          is_clipped_right(values.right < modelled.right + reach),
          memory(s.acquire_memory()) {
        const int64_t one = stride * f * s.tile_rows, all = C * one;
        memory.resize(static_cast<size_t>(6 * all + 2 * one + C * stride * s.tile_rows / f));
        float* next = memory.data();
        for (float** plane : {&fine, &d, &product, &image, &x, &residual}) *plane = next, next += all;
        stiffness = next, scale = next + one, slope2 = next + 2 * one;
    }
    ~Work() { s.release_memory(std::move(memory)); }
    Work(const Work&) = delete;
    Work& operator=(const Work&) = delete;

    float* row_of(float* plane, int row, int channel, int within) const {
        return plane + ((int64_t{C} * row + channel) * f + within) * stride;
    }
    float* row_of(float* plane, int row, int within) const { return plane + (int64_t{f} * row + within) * stride; }

    int64_t row_size() const { return C * f * stride; }
};

// Repeat values once at the borders, so that differences across them are 0.
template <int C>
void replicate_ends(const Work<C>& w, float* plane, int row) {
    for (int c = 0; c < C; ++c) {
        float *first = w.row_of(plane, row, c, 0), *last = w.row_of(plane, row, c, w.f - 1);
        last[w.values.left - 1] = first[w.values.left];
        first[w.values.right] = last[w.values.right - 1];
    }
    const auto copy_to = [&](int other) {
        std::memcpy(w.row_of(plane, other, 0, 0), w.row_of(plane, row, 0, 0), sizeof(float) * w.row_size());
    };
    if (row == w.f * w.values.top) copy_to(row - 1);
    if (row == w.f * w.values.bottom - 1) copy_to(row + 1);
}

// Replicate the edge of the image beyond it.
template <int C>
void replicate_edge(const Work<C>& w, int row) {
    for (int c = 0; c < C; ++c) {
        const float first = w.row_of(w.image, row, c, 0)[w.values.left];
        const float last = w.row_of(w.image, row, c, w.f - 1)[w.values.right - 1];
        for (int within = 0; within < w.f; ++within) {
            float* at = w.row_of(w.image, row, c, within);
            if (w.is_clipped_left) std::fill(at + w.values.left - w.reach, at + w.values.left, first);
            if (w.is_clipped_right) std::fill(at + w.values.right, at + w.values.right + w.reach, last);
        }
    }
    const auto copy_to = [&](int begin, int end) {
        for (int other = begin; other < end; ++other)
            std::memcpy(w.row_of(w.image, other, 0, 0), w.row_of(w.image, row, 0, 0), sizeof(float) * w.row_size());
    };
    const int first = w.f * w.values.top, end = w.f * w.values.bottom;
    if (row == first) copy_to(w.f * (w.modelled.top - w.reach), first);
    if (row == end - 1) copy_to(end, w.f * (w.modelled.bottom + w.reach));
}

// The transpose: values spread beyond the image are added at its edge.
template <int C>
void fold_edge(const Work<C>& w, int row) {
    const auto add_from = [&](int begin, int end) {
        for (int other = begin; other < end; ++other)
            for (int64_t i = 0; i < w.row_size(); ++i)
                w.row_of(w.product, row, 0, 0)[i] += w.row_of(w.product, other, 0, 0)[i];
    };
    const int first = w.f * w.values.top, end = w.f * w.values.bottom;
    if (row == first) add_from(w.f * (w.modelled.top - w.reach), first);
    if (row == end - 1) add_from(end, w.f * (w.modelled.bottom + w.reach));
    for (int c = 0; c < C; ++c) {
        float& first_value = w.row_of(w.product, row, c, 0)[w.values.left];
        float& last_value = w.row_of(w.product, row, c, w.f - 1)[w.values.right - 1];
        for (int within = 0; within < w.f; ++within) {
            const float* at = w.row_of(w.product, row, c, within);
            for (int i = 1; w.is_clipped_left && i <= w.reach; ++i) first_value += at[w.values.left - i];
            for (int i = 0; w.is_clipped_right && i < w.reach; ++i) last_value += at[w.values.right + i];
        }
    }
}

// -- the blur ----------------------------------------------------------------------------------------------

// Kernels of the blocks of a group, and all taps.
struct Group {
    const int32_t *kernels, *first_taps;
    const PlacedTap* taps;
    int block;

    const PlacedTap* begin(int n) const { return taps + first_taps[kernels[n]]; }
    const PlacedTap* end(int n) const { return taps + first_taps[kernels[n] + 1]; }
};

// b_i = sum_j A_ij f_j of N pixels i of a group: f is the image from the first value of the pixels on, A their kernels.
template <int C, int N>
OMNIMIRROR_NOINLINE void blur_group(const Group& group, const float* image, int64_t channel, float* blurred) {
    using Some = typename Vector<N>::Lanes;
    for (int n = 0; n < GROUP / N; ++n) {
        Some even[C] = {}, odd[C] = {};
        if (group.kernels[n] >= 0)
            for (const PlacedTap *tap = group.begin(n), *end = group.end(n); tap < end; tap += 2) {
                const float *one = image + N * n + tap[0].place, *other = image + N * n + tap[1].place;
                for (int c = 0; c < C; ++c) {
                    even[c] += tap[0].weight * load<Some>(one + c * channel);
                    odd[c] += tap[1].weight * load<Some>(other + c * channel);
                }
            }
        for (int c = 0; c < C; ++c) store(blurred + GROUP * c + N * n, even[c] + odd[c]);
    }
}

// p_j += A_ij b_i, the transpose. Taps of one row are not consecutive: a load would wait for the previous store.
template <int C, int N>
OMNIMIRROR_NOINLINE void spread_group(const Group& group, float* product, int64_t channel, const float* blurred) {
    using Some = typename Vector<N>::Lanes;
    for (int n = 0; n < GROUP / N; ++n) {
        if (group.kernels[n] < 0) continue;
        Some values[C];
        for (int c = 0; c < C; ++c) values[c] = load<Some>(blurred + GROUP * c + N * n);
        for (const PlacedTap *tap = group.begin(n), *end = group.end(n); tap < end; ++tap) {
            float* const at = product + N * n + tap->place;
            for (int c = 0; c < C; ++c) store(at + c * channel, load<Some>(at + c * channel) + tap->weight * values[c]);
        }
    }
}

template <int C>
inline void blur(const Group& group, const float* image, int64_t channel, float* blurred) {
    switch (group.block) {
        case 8: return blur_group<C, 8>(group, image, channel, blurred);
        case 4: return blur_group<C, 4>(group, image, channel, blurred);
        case 2: return blur_group<C, 2>(group, image, channel, blurred);
        default: return blur_group<C, 1>(group, image, channel, blurred);
    }
}

template <int C>
inline void spread(const Group& group, float* product, int64_t channel, const float* blurred) {
    switch (group.block) {
        case 8: return spread_group<C, 8>(group, product, channel, blurred);
        case 4: return spread_group<C, 4>(group, product, channel, blurred);
        case 2: return spread_group<C, 2>(group, product, channel, blurred);
        default: return spread_group<C, 1>(group, product, channel, blurred);
    }
}

// Call f(group, index of its first value, column) for the groups of a row of pixels that contain known pixels.
template <int C, class F>
inline void for_groups(const Work<C>& w, int row, F f) {
    const BlurKernels& k = w.s.blur;
    const int blocks = GROUP / k.block;
    const int32_t* kernels =
        k.kernels.data() + int64_t{blocks} * (k.groups() * int64_t{w.top + row} + (w.left + w.modelled.left) / GROUP);
    for (int x = w.modelled.left; x < w.modelled.right; x += GROUP, kernels += blocks)
        if (std::any_of(kernels, kernels + blocks, [](int32_t kernel) { return kernel >= 0; }))
            f(Group{kernels, k.first_taps.data(), w.s.taps.data(), k.block}, w.row_size() * w.f * row + x, x);
}

// product = A^T f(A image), row by row as soon as each is available: prepare(row) of the image; explain(row of pixels,
// column, blurred group) modifies a group; finish(row) of the product.
template <int C, class Prepare, class Explain, class Finish>
void sweep(const Work<C>& w, Prepare prepare, Explain transform_group, Finish finish) {
    const int f = w.f, reach = w.reach;
    const int64_t channel = f * w.stride;
    const auto clear = [&](int begin, int end) {
        if (begin < end) std::memset(w.row_of(w.product, begin, 0, 0), 0, sizeof(float) * w.row_size() * (end - begin));
    };
    clear(f * (w.modelled.top - reach), f * w.values.top);
    clear(f * w.values.bottom, f * (w.modelled.bottom + reach));
    for (int y = w.values.top; y < w.values.bottom + 2 * reach; ++y) {
        for (int row = f * y; y < w.values.bottom && row < f * (y + 1); ++row) {
            prepare(row);
            replicate_edge(w, row);
            clear(row, row + 1);
        }
        const int blurred_row = y - reach, finished_row = y - 2 * reach;
        if (w.modelled.top <= blurred_row && blurred_row < w.modelled.bottom)
            for_groups(w, blurred_row, [&](const Group& group, int64_t place, int x) {
                float blurred[C * GROUP];
                blur<C>(group, w.image + place, channel, blurred);
                transform_group(blurred_row, x, blurred);
                spread<C>(group, w.product + place, channel, blurred);
            });
        for (int row = f * finished_row; finished_row >= w.values.top && row < f * (finished_row + 1); ++row) {
            fold_edge(w, row);
            finish(row);
        }
    }
}

}  // namespace
}  // namespace omnimirror
