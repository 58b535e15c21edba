// Source coordinates of output pixels, 8 at a time.
#pragma once

#include "avx2.hpp"
#include "locate.hpp"

namespace omnimirror {
namespace {

// One coordinate of 8 pixels.
struct Axis {
    __m256i first;  // the pixel to the left or above
    __m256 fraction;
    __m256i inside;  // all bits set if the coordinate is inside the image
};

Axis along(const float* at, int size, int first_max) {
    const __m256 x = _mm256_loadu_ps(at);
    const float last = static_cast<float>(size - 1), end = static_cast<float>(size - 0.5);
    const __m256 inside = _mm256_and_ps(_mm256_cmp_ps(x, _mm256_set1_ps(-0.5f), _CMP_GE_OQ),
                                        _mm256_cmp_ps(x, _mm256_set1_ps(end), _CMP_LE_OQ));
    const __m256 clamped = _mm256_min_ps(_mm256_max_ps(x, _mm256_setzero_ps()), _mm256_set1_ps(last));
    const __m256i first = _mm256_min_epi32(_mm256_cvttps_epi32(clamped), _mm256_set1_epi32(first_max));
    return {first, _mm256_sub_ps(clamped, _mm256_cvtepi32_ps(first)), _mm256_castps_si256(inside)};
}

struct HalfAxis {
    __m128i first, inside;
    __m128 fraction;
};

HalfAxis along_half(const double* at, int size, int first_max) {
    const __m256d x = _mm256_loadu_pd(at);
    const __m256d inside = _mm256_and_pd(_mm256_cmp_pd(x, _mm256_set1_pd(-0.5), _CMP_GE_OQ),
                                         _mm256_cmp_pd(x, _mm256_set1_pd(size - 0.5), _CMP_LE_OQ));
    const __m256d clamped = _mm256_min_pd(_mm256_max_pd(x, _mm256_setzero_pd()), _mm256_set1_pd(size - 1));
    const __m128i first = _mm_min_epi32(_mm256_cvttpd_epi32(clamped), _mm_set1_epi32(first_max));
    const __m128 fraction = _mm256_cvtpd_ps(_mm256_sub_pd(clamped, _mm256_cvtepi32_pd(first)));
    const __m256i words = _mm256_castpd_si256(inside);
    const __m128i low = _mm256_castsi256_si128(words), high = _mm256_extracti128_si256(words, 1);
    return {first, _mm_packs_epi32(low, high), fraction};
}

Axis along(const double* at, int size, int first_max) {
    const HalfAxis a = along_half(at, size, first_max), b = along_half(at + 4, size, first_max);
    // The masks were packed to words, each of them twice, which form 32-bit masks again.
    return {_mm256_set_m128i(b.first, a.first), _mm256_set_m128(b.fraction, a.fraction),
            _mm256_set_m128i(b.inside, a.inside)};
}

__m256i is_beyond(__m256i first, int inner, uint32_t span) {
    const __m256i from = _mm256_sub_epi32(first, _mm256_set1_epi32(inner)),
                  maximum = _mm256_set1_epi32(static_cast<int>(span));
    return _mm256_xor_si256(_mm256_cmpeq_epi32(_mm256_max_epu32(from, maximum), maximum), _mm256_set1_epi32(-1));
}

__m256i in_255ths(__m256 fraction) {
    return _mm256_cvttps_epi32(_mm256_add_ps(_mm256_mul_ps(fraction, _mm256_set1_ps(255.0f)), _mm256_set1_ps(0.5f)));
}

void store_fractions(__m256i x, __m256i y, Block<uint8_t>& block) {
    const __m256i words = _mm256_packs_epi32(x, y);  // x 0-3, y 0-3; x 4-7, y 4-7
    const __m256i bytes = _mm256_packus_epi16(words, words);
    const __m128i sorted = _mm_unpacklo_epi32(_mm256_castsi256_si128(bytes), _mm256_extracti128_si256(bytes, 1));
    static_assert(offsetof(Block<uint8_t>, fy) == offsetof(Block<uint8_t>, fx) + 8);
    store16(block.fx, sorted);
}

// Same as locate in common.hpp, 8 pixels at a time.
template <Interpolation I, class Real>
void locate_by_8(const Real* x, const Real* y, int count, const Geometry& geometry, Block<uint8_t>* blocks) {
    const Geometry g = geometry;
    const __m256i row_step = _mm256_set1_epi32(static_cast<int>(g.row_step));
    const __m256i pixel_step = _mm256_set1_epi32(static_cast<int>(g.pixel_step));
    for (int i = 0; i < count; i += 8) {
        const Axis across = along(x + i, g.width, g.x0_max), down = along(y + i, g.height, g.y0_max);
        store_fractions(in_255ths(across.fraction), in_255ths(down.fraction), blocks[i / 8]);
        const __m256i all = _mm256_set1_epi32(-1), inside = _mm256_and_si256(across.inside, down.inside);
        __m256i offset =
            _mm256_add_epi32(_mm256_mullo_epi32(down.first, row_step), _mm256_mullo_epi32(across.first, pixel_step));
        if constexpr (I == Interpolation::cubic) {
            const __m256i margin = _mm256_or_si256(is_beyond(across.first, g.x_inner, g.x_span),
                                                   is_beyond(down.first, g.y_inner, g.y_span));
            const __m256i edge = _mm256_set1_epi32(static_cast<int>(EDGE));
            offset = _mm256_or_si256(offset, _mm256_and_si256(margin, edge));
        }
        offset = _mm256_or_si256(offset, _mm256_xor_si256(inside, all));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(blocks[i / 8].offsets), offset);
    }
}

// Return whether all sizes and steps of an image fit into signed 16-bit integers.
bool is_narrow(const Geometry& g) { return g.width <= 0x7fff && g.height <= 0x7fff && g.row_step <= 0x7fff; }

// Same for inner coordinates and narrow images, 8 at a time and in units of 1/65536 pixel. The speed is limited by the
// length of the dependency chain, which is therefore short.
struct InnerLocator {
    __m256i steps, half = in_register(_mm256_set1_epi16(128));
    __m256i channel_order =
        in_register(duplicate_lane(_mm_setr_epi8(1, 5, 9, 13, 3, 7, 11, 15, -1, -1, -1, -1, -1, -1, -1, -1)));
    __m256i pixel_order = in_register(_mm256_setr_epi32(0, 4, 1, 5, 0, 4, 1, 5));

    explicit InnerLocator(const Geometry& g)
        : steps(in_register(_mm256_set1_epi32(static_cast<int>(g.row_step << 16 | g.pixel_step)))) {}

    void store_block(__m256 x_fine, __m256 y_fine, Block<uint8_t>& block) const {
        const __m256i x = _mm256_cvtps_epi32(x_fine), y = _mm256_cvtps_epi32(y_fine);
        const __m256i pixels = _mm256_blend_epi16(_mm256_srli_epi32(x, 16), y, 0xaa);
        const __m256i fractions = _mm256_blend_epi16(x, _mm256_slli_epi32(y, 16), 0xaa);
        const __m256i in_255ths = _mm256_add_epi16(_mm256_sub_epi16(fractions, _mm256_srli_epi16(fractions, 8)), half);
        const __m256i bytes = _mm256_shuffle_epi8(in_255ths, channel_order);
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(block.offsets), _mm256_madd_epi16(pixels, steps));
        store16(block.fx, _mm256_castsi256_si128(_mm256_permutevar8x32_epi32(bytes, pixel_order)));
    }
};

// See cell_row in common.hpp.
struct FourNodes {
    __m256 a, b, c, d;

    explicit FourNodes(const float* nodes)
        : a(_mm256_broadcast_ss(nodes)),
          b(_mm256_broadcast_ss(nodes + 1)),
          c(_mm256_broadcast_ss(nodes + 2)),
          d(_mm256_broadcast_ss(nodes + 3)) {}

    __m256 between(const float* w, int step) const {
        const __m256 left = _mm256_fmadd_ps(b, _mm256_loadu_ps(w + step), _mm256_mul_ps(a, _mm256_loadu_ps(w)));
        const __m256 right =
            _mm256_fmadd_ps(d, _mm256_loadu_ps(w + 3 * step), _mm256_mul_ps(c, _mm256_loadu_ps(w + 2 * step)));
        return _mm256_add_ps(left, right);
    }
};

void cell_row_by_8(const float* nodes, const float* weights, int step, float* out) {
    const FourNodes four(nodes);
    for (int i = 0; i < step; i += 8) _mm256_storeu_ps(out + i, four.between(weights + i, step));
}

template <int step>
void locate_narrow_cells(const float* weights, const CellRow& r, const Geometry& g, Block<uint8_t>* blocks) {
    const InnerLocator locator(g);
    for (int j = 0; j < r.count; ++j) {
        const FourNodes x(r.fine_x + j), y(r.fine_y + j);
        for (int i = 0; i < step; i += 8)
            locator.store_block(x.between(weights + i, step), y.between(weights + i, step), *blocks++);
    }
}

void locate_narrow_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<uint8_t>* blocks) {
    const InnerLocator locator(g);
    const __m256 radius = _mm256_set1_ps(p.radii[row] * FINE);
    const __m256 x = _mm256_set1_ps(p.x * FINE), y = _mm256_set1_ps(p.y * FINE);
    const float *cosines = p.cosines + column, *sines = p.sines + column;
    for (int i = 0; i < count; i += 8)
        locator.store_block(_mm256_fmadd_ps(radius, _mm256_loadu_ps(cosines + i), x),
                            _mm256_fmadd_ps(radius, _mm256_loadu_ps(sines + i), y), blocks[i / 8]);
}

}  // namespace
}  // namespace omnimirror
