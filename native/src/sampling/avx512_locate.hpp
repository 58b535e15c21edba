// Source coordinates of output pixels, 16 at a time, for inner coordinates and narrow images.
#pragma once

#include "avx2_locate.hpp"
#include "avx512.hpp"

namespace omnimirror {
namespace {

// Same computation as InnerLocator.
struct WideLocator {
    __m512i steps, half = in_register(_mm512_set1_epi16(128));
    // Fractions are in the upper bytes of words, x before y; those of one block are contiguous.
    __m512i order = bytes_of<[](int i) { return i % 32 / 16 * 32 + i % 8 * 4 + i % 16 / 8 * 2 + 1; }>();

    explicit WideLocator(const Geometry& g)
        : steps(in_register(_mm512_set1_epi32(static_cast<int>(g.row_step << 16 | g.pixel_step)))) {}

    void store_block(__m512 x_fine, __m512 y_fine, Block<uint8_t>* b) const {
        const __m512i x = _mm512_cvtps_epi32(x_fine), y = _mm512_cvtps_epi32(y_fine);
        const __m512i pixels = _mm512_mask_blend_epi16(ODD_WORDS, _mm512_srli_epi32(x, 16), y);
        const __m512i fractions = _mm512_mask_blend_epi16(ODD_WORDS, x, _mm512_slli_epi32(y, 16));
        const __m512i in_255ths = _mm512_add_epi16(_mm512_sub_epi16(fractions, _mm512_srli_epi16(fractions, 8)), half);
        const __m512i offsets = _mm512_madd_epi16(pixels, steps);
        const __m256i bytes = _mm512_castsi512_si256(_mm512_permutexvar_epi8(order, in_255ths));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(b[0].offsets), _mm512_castsi512_si256(offsets));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(b[1].offsets), _mm512_extracti64x4_epi64(offsets, 1));
        store16(b[0].fx, _mm256_castsi256_si128(bytes));
        store16(b[1].fx, _mm256_extracti128_si256(bytes, 1));
    }
};

// See cell_row in locate.hpp: 16 pixels of one row of a cell.
struct WideWeights {
    __m512 a, b, c, d;

    WideWeights(const float* w, int step)
        : a(_mm512_loadu_ps(w)),
          b(_mm512_loadu_ps(w + step)),
          c(_mm512_loadu_ps(w + 2 * step)),
          d(_mm512_loadu_ps(w + 3 * step)) {}

    __m512 between(const float* nodes) const {
        const __m512 left = _mm512_fmadd_ps(_mm512_set1_ps(nodes[1]), b, _mm512_mul_ps(_mm512_set1_ps(nodes[0]), a));
        const __m512 right = _mm512_fmadd_ps(_mm512_set1_ps(nodes[3]), d, _mm512_mul_ps(_mm512_set1_ps(nodes[2]), c));
        return _mm512_add_ps(left, right);
    }
};

template <int step>
void locate_wide_cells(const float* weights, const CellRow& r, const Geometry& g, Block<uint8_t>* blocks) {
    const WideLocator locator(g);
    for (int i = 0; i < step; i += 16) {
        const WideWeights across(weights + i, step);
        Block<uint8_t>* first = blocks + i / 8;
        for (int j = 0; j < r.count; ++j, first += step / 8)
            locator.store_block(across.between(r.fine_x + j), across.between(r.fine_y + j), first);
    }
}

// count is a multiple of 8; directions are readable beyond their end, but blocks are not writable there.
void locate_wide_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<uint8_t>* blocks) {
    const WideLocator locator(g);
    const __m512 radius = _mm512_set1_ps(p.radii[row] * FINE);
    const __m512 x = _mm512_set1_ps(p.x * FINE), y = _mm512_set1_ps(p.y * FINE);
    const float *cosines = p.cosines + column, *sines = p.sines + column;
    for (int i = 0; i + 8 < count; i += 16)
        locator.store_block(_mm512_fmadd_ps(radius, _mm512_loadu_ps(cosines + i), x),
                            _mm512_fmadd_ps(radius, _mm512_loadu_ps(sines + i), y), blocks + i / 8);
    if (count % 16) locate_narrow_ring(p, row, column + count - 8, 8, g, blocks + count / 8 - 1);
}

}  // namespace
}  // namespace omnimirror
