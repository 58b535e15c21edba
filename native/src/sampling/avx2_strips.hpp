// Strips of pixels with AVX2. Only uint8 images, the usual format of frames, have dedicated kernels.
//
// For each output pixel, a few unaligned loads fetch all neighbours in all channels; scalar address arithmetic is
// faster than hardware gathers of 32 bytes.
#pragma once

#include "avx2_cubic.hpp"
#include "avx2_linear.hpp"
#include "avx2_locate.hpp"
#include "footprint.hpp"

namespace omnimirror {
namespace {

// Mask of the pixels (of 8) that the fast kernel must not process: outside, at an edge, or too near the end of the
// memory.
int unsafe_mask(const uint32_t* offsets, __m256i last) {
    const __m256i o = load32(offsets);
    const __m256i safe = _mm256_cmpeq_epi32(_mm256_max_epu32(o, last), last);
    return _mm256_movemask_ps(_mm256_castsi256_ps(safe)) ^ 0xff;
}

// 8 pixels, some of them unfit or beyond count. A separate function, so that it takes no registers from the fast path.
template <class Kernel, Interpolation I, int C>
[[gnu::noinline]] void sample_mixed(const Job& job, const Kernel& kernel, const Block<uint8_t>& b, int unsafe_bits,
                                    int count, uint8_t* out) {
    uint8_t pixels[8 * C];
    if (unsafe_bits != 0xff) {
        Block<uint8_t> safe = b;
        const uint32_t other = b.offsets[__builtin_ctz(~unsafe_bits)];
        for (int i = 0; i < 8; ++i)
            if (unsafe_bits >> i & 1) safe.offsets[i] = other;
        kernel.sample_8(safe, pixels);
    }
    for (int i = 0; i < count; ++i)
        if (unsafe_bits >> i & 1) sample_pixel<I, C>(job, b.offsets[i], b.fx[i], b.fy[i], pixels + i * C);
    std::memcpy(out, pixels, static_cast<size_t>(count * C));
}

// Prefetch every second pixel of the upper row: more prefetches cost more time than they save.
void prefetch_source(const uint8_t* data, const uint32_t* offsets) {
    for (int i = 0; i < 8; i += 2)
        _mm_prefetch(reinterpret_cast<const char*>(data) + (offsets[i] & ~EDGE), _MM_HINT_T0);
}

template <class Kernel, Interpolation I, int C>
void sample_by_8(const Job& job, const Strip<uint8_t>& s) {
    const Kernel kernel(job.source);
    const __m256i last = _mm256_set1_epi32(static_cast<int>(kernel.last));
    for (int i = 0; i < s.count; i += 8) {
        const Block<uint8_t>& block = s.blocks[i / 8];
        const int bits = unsafe_mask(block.offsets, last), left = s.count - i;
        _mm_prefetch(reinterpret_cast<const char*>(&block) + 2048, _MM_HINT_T0);  // a packed map continues there
        if (s.prefetched) prefetch_source(kernel.data, s.prefetched[i / 8].offsets);
        if (__builtin_expect(!bits && left >= 8, 1))
            kernel.sample_8(block, s.out + i * C);
        else
            sample_mixed<Kernel, I, C>(job, kernel, block, bits, min_of(left, 8), s.out + i * C);
    }
}

// Means of 8 sums, in 32 bits.
__m256i means(const int32_t* sums, float scale) {
    const __m256 values = _mm256_mul_ps(_mm256_cvtepi32_ps(load32(sums)), _mm256_set1_ps(scale));
    return _mm256_cvttps_epi32(_mm256_add_ps(_mm256_max_ps(values, _mm256_setzero_ps()), _mm256_set1_ps(0.5f)));
}

template <int C>
void mean_by_8(const int32_t* sums, int count, uint8_t* out) {
    const float scale = 1 / (SUM_ONE * static_cast<float>(count));
    const auto words = [](__m256i values) {
        return _mm_packs_epi32(_mm256_castsi256_si128(values), _mm256_extracti128_si256(values, 1));
    };
    if constexpr (C == 1) {
        const __m128i values = words(means(sums, scale));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_packus_epi16(values, values));
    } else if constexpr (C == 2) {
        store16(out, _mm_packus_epi16(words(means(sums, scale)), words(means(sums + 8, scale))));
    } else {
        const __m256i first = _mm256_packs_epi32(means(sums, scale), means(sums + 8, scale));
        const __m256i second = _mm256_packs_epi32(means(sums + 16, scale), means(sums + 24, scale));
        Writer<C>().write(_mm256_packus_epi16(first, second), out);
    }
}

struct Avx2 {
    static void cell_row(const float* x_nodes, const float* y_nodes, const float* weights, int step, float* x,
                         float* y) {
        cell_row_by_8(x_nodes, weights, step, x);
        cell_row_by_8(y_nodes, weights, step, y);
    }

    template <Interpolation I, class F>
    static constexpr bool has_fractions_of_8 = sizeof(F) == 1 && I != Interpolation::nearest;

    template <Interpolation I, class Real, class F>
    static void locate(const Real* x, const Real* y, int count, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (sizeof(Real) == sizeof(double) || !is_long(g)) return locate_by_8<I>(x, y, count, g, blocks);
        }
        Plain::locate<I>(x, y, count, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_cells(const Lattice& n, const CellRow& r, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g) && r.step == 32) return locate_narrow_cells<32>(n.weights, r, g, blocks);
            if (is_narrow(g) && r.step == 16) return locate_narrow_cells<16>(n.weights, r, g, blocks);
            if (is_narrow(g) && r.step == 8) return locate_narrow_cells<8>(n.weights, r, g, blocks);
        }
        Plain::locate_inner_cells<I>(n, r, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<F>* blocks) {
        if constexpr (has_fractions_of_8<I, F>) {
            if (is_narrow(g)) return locate_narrow_ring(p, row, column, count, g, blocks);
        }
        Plain::locate_inner_ring<I>(p, row, column, count, g, blocks);
    }

    template <Interpolation I, int C, class T>
    static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        if constexpr (sizeof(T) == 1 && I == Interpolation::linear)
            sample_by_8<Linear<C>, I, C>(job, s);
        else if constexpr (sizeof(T) == 1 && I == Interpolation::cubic)
            sample_by_8<Cubic<C>, I, C>(job, s);
        else
            Plain::sample_strip<I, C, T>(job, s);
    }
};

struct Avx2Sums {
    // A separate function, so that loop invariants stay in registers.
    template <int C, class T>
    [[gnu::noinline]] static void add_taps(const Source& source, const Block<Fraction<T>>* blocks, int count,
                                           Sum<T>* sums, uint16_t* inside) {
        if constexpr (sizeof(T) == 1) {
            const Cubic<C> kernel(source);
            const __m256i last = _mm256_set1_epi32(static_cast<int>(kernel.last));
            for (int i = 0; i < count; i += 8) {
                if (unsafe_mask(blocks[i / 8].offsets, last)) {
                    add_8_taps<C, T>(source, blocks[i / 8], sums + i * CHANNELS_OF_SUMS<C>, inside + i);
                    continue;
                }
                kernel.add_8(blocks[i / 8], sums + i * CHANNELS_OF_SUMS<C>);
                auto* counts = reinterpret_cast<__m128i*>(inside + i);
                _mm_storeu_si128(counts, _mm_add_epi16(load16(counts), _mm_set1_epi16(1)));
            }
        } else {
            PlainSums::add_taps<C, T>(source, blocks, count, sums, inside);
        }
    }

    template <int C, class T>
    static void mean_of_8(const Sum<T>* sums, int count, T* out) {
        if constexpr (sizeof(T) == 1)
            mean_by_8<C>(sums, count, out);
        else
            PlainSums::mean_of_8<C, T>(sums, count, out);
    }
};

}  // namespace

}  // namespace omnimirror
