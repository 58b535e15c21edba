// Bilinear samples of uint8 images, 16 pixels at a time. See linear_pixel for the arithmetic.
#pragma once

#include "avx2_linear.hpp"
#include "avx512.hpp"

namespace omnimirror {
namespace {

// The arithmetic of linear_pixel: 32 values minus 128, as words, from 64 bytes in each row: pairs of adjacent
// neighbours.
struct WideBilinear {
    __m512i sign = in_register(_mm512_set1_epi8(-128)), complement = in_register(_mm512_set1_epi16(0x00ff));
    __m512i weight = in_register(_mm512_set1_epi16(129 * 128)), one = in_register(_mm512_set1_epi16(LINEAR_ONE));
    __m512i round = in_register(_mm512_set1_epi16(256));

    // Fractions are in both bytes of a pair.
    __m512i across(__m512i fx, __m512i row) const {
        return _mm512_maddubs_epi16(_mm512_xor_si512(fx, complement), _mm512_xor_si512(row, sign));
    }

    // Fractions are in the upper byte of a word.
    __m512i lower_weights(__m512i fy) const { return _mm512_mulhi_epu16(fy, weight); }

    __m512i interpolate(__m512i fx, __m512i fy, __m512i upper_row, __m512i lower_row) const {
        const __m512i lower_weight = lower_weights(fy), upper_weight = _mm512_sub_epi16(one, lower_weight);
        const __m512i upper = _mm512_mulhrs_epi16(across(fx, upper_row), upper_weight);
        const __m512i lower = _mm512_mulhrs_epi16(across(fx, lower_row), lower_weight);
        return _mm512_mulhrs_epi16(_mm512_add_epi16(upper, lower), round);
    }
};

// Fractions of two blocks: x and y of the first 8 pixels, x and y of the other 8.
__m512i fractions_of(const Block<uint8_t>* b) {
    return _mm512_castsi256_si512(_mm256_set_m128i(load16(b[1].fx), load16(b[0].fx)));
}
constexpr int place_of_fraction(int pixel) { return pixel / 8 * 16 + pixel % 8; }

__m512i offsets_of(const Block<uint8_t>* b) {
    return _mm512_inserti64x4(_mm512_castsi256_si512(load32(b[0].offsets)), load32(b[1].offsets), 1);
}

// Load 8 bytes from each of 8 addresses with one gather instruction, which is faster than single loads on Intel CPUs.
struct Gathered {
    static __m512i eights(const uint8_t* row, const uint32_t* offsets) {
        return _mm512_i32gather_epi64(load32(offsets), row, 1);
    }
};

// The same with single loads, which take half the time on AMD CPUs.
struct Loaded {
    static __m512i eights(const uint8_t* row, const uint32_t* o) {
        const auto two = [&](int i) { return load_pair(row + o[i], row + o[i + 1]); };
        const __m256i first = _mm256_set_m128i(two(2), two(0)), second = _mm256_set_m128i(two(6), two(4));
        return _mm512_inserti64x4(_mm512_castsi256_si512(first), second, 1);
    }
};

// Colour: 8 bytes are loaded per pixel and row.
template <class Fetch, int C>
struct WideLinear {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;  // the last offset at which 8 bytes of both rows are readable
    __m512i pairs = in_register(_mm512_broadcast_i32x4(_mm256_castsi256_si128(pairs_of_channels<C>())));
    __m512i x_places = bytes_of<[](int i) { return i / 8; }>();
    __m512i y_places = bytes_of<[](int i) { return i / 8 + 8; }>();
    // Two pixels of 4 bytes from the first block alternate with two from the second.
    __m512i order = bytes_of<[](int i) {
        const int pixel = i / C % 16;
        return pixel % 8 / 2 * 16 + pixel / 8 * 8 + pixel % 2 * 4 + i % C;
    }>();
    WideBilinear bilinear;

    explicit WideLinear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 8)) {}

    __m512i values(const uint8_t* row, const uint32_t* offsets) const {
        return _mm512_shuffle_epi8(Fetch::eights(row, offsets), pairs);
    }

    __m512i sample_8(const Block<uint8_t>& b) const {
        const __m512i fractions = _mm512_castsi128_si512(load16(b.fx));
        const __m512i x = _mm512_permutexvar_epi8(x_places, fractions);
        const __m512i y = _mm512_maskz_permutexvar_epi8(ODD_BYTES, y_places, fractions);
        return bilinear.interpolate(x, y, values(data, b.offsets), values(data + row_step, b.offsets));
    }

    void sample_16(const Block<uint8_t>* b, uint8_t* out) const {
        const __m512i bytes = _mm512_packs_epi16(sample_8(b[0]), sample_8(b[1]));
        const __m512i pixels = _mm512_permutexvar_epi8(order, _mm512_xor_si512(bytes, bilinear.sign));
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), _mm512_castsi512_si256(pixels));
        if constexpr (C == 4)
            _mm256_storeu_si256(reinterpret_cast<__m256i*>(out + 32), _mm512_extracti64x4_epi64(pixels, 1));
        else
            store16(out + 32, _mm512_extracti32x4_epi32(pixels, 2));
    }
};

// Two channels: both neighbours of a pixel are 4 bytes. For two channels and for grey, 64 bytes at a time are faster
// only with gathers.
template <>
struct WideLinear<Gathered, 2> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;
    __m512i pairs = bytes_of<[](int i) { return i % 16 / 4 * 4 + i % 4 / 2 + i % 2 * 2; }>();
    __m512i x_places = bytes_of<[](int i) { return place_of_fraction(i / 4); }>();
    __m512i y_places = bytes_of<[](int i) { return place_of_fraction(i / 4) + 8; }>();
    WideBilinear bilinear;

    explicit WideLinear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 4)) {}

    __m512i values(const uint8_t* row, __m512i offsets) const {
        return _mm512_shuffle_epi8(_mm512_i32gather_epi32(offsets, row, 1), pairs);
    }

    void sample_16(const Block<uint8_t>* b, uint8_t* out) const {
        const __m512i offsets = offsets_of(b), fractions = fractions_of(b);
        const __m512i x = _mm512_permutexvar_epi8(x_places, fractions);
        const __m512i y = _mm512_maskz_permutexvar_epi8(ODD_BYTES, y_places, fractions);
        const __m512i words = bilinear.interpolate(x, y, values(data, offsets), values(data + row_step, offsets));
        const __m256i bytes = _mm512_cvtsepi16_epi8(words);
        _mm256_storeu_si256(reinterpret_cast<__m256i*>(out),
                            _mm256_xor_si256(bytes, _mm512_castsi512_si256(bilinear.sign)));
    }
};

// Grey: the four neighbours of a pixel are 4 bytes, two in each row.
template <>
struct WideLinear<Gathered, 1> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;
    __m512i x_places = bytes_of<[](int i) { return place_of_fraction(i / 4); }>();
    __m512i y_places = bytes_of<[](int i) { return place_of_fraction(i / 4) + 8; }>();
    __m512i ones = in_register(_mm512_set1_epi16(1)), half = in_register(_mm512_set1_epi32(64));
    WideBilinear bilinear;

    explicit WideLinear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 4)) {}

    void sample_16(const Block<uint8_t>* b, uint8_t* out) const {
        const __m512i offsets = offsets_of(b), fractions = fractions_of(b);
        const __m512i x = _mm512_permutexvar_epi8(x_places, fractions);
        const __m512i y = _mm512_maskz_permutexvar_epi8(ODD_BYTES, y_places, fractions);
        const __m512i upper = _mm512_i32gather_epi32(offsets, data, 1);
        const __m512i lower = _mm512_slli_epi32(_mm512_i32gather_epi32(offsets, data + row_step, 1), 16);
        const __m512i rows = bilinear.across(x, _mm512_mask_blend_epi16(ODD_WORDS, upper, lower));
        const __m512i down = bilinear.lower_weights(y);
        const __m512i weights = _mm512_mask_sub_epi16(down, ~ODD_WORDS, bilinear.one, down);
        const __m512i sums = _mm512_madd_epi16(_mm512_mulhrs_epi16(rows, weights), ones);
        const __m512i values = _mm512_srai_epi32(_mm512_add_epi32(sums, half), 7);
        store16(out, _mm_xor_si128(_mm512_cvtsepi32_epi8(values), _mm512_castsi512_si128(bilinear.sign)));
    }
};

}  // namespace
}  // namespace omnimirror
