// Bilinear samples of uint8 images, 8 pixels at a time. See linear_pixel for the arithmetic.
#pragma once

#include "avx2.hpp"
#include "pixel.hpp"

namespace omnimirror {
namespace {

// Both neighbours in one row of 4 pixels: pixels 0, 1, 4 and 5 of offsets.
__m256i load_row(const uint8_t* row, const uint32_t* offsets) {
    return _mm256_set_m128i(load_pair(row + offsets[4], row + offsets[5]),
                            load_pair(row + offsets[0], row + offsets[1]));
}

template <int C>
__m256i pairs_of_channels() {
    const __m128i pairs = C == 3 ? _mm_setr_epi8(0, 3, 1, 4, 2, 5, 2, 5, 8, 11, 9, 12, 10, 13, 10, 13)
                                 : _mm_setr_epi8(0, 4, 1, 5, 2, 6, 3, 7, 8, 12, 9, 13, 10, 14, 11, 15);
    return duplicate_lane(pairs);
}

// Bytes of pixels first, first + 1, first + 4 and first + 5 of the 8 in each half, each repeated 4 times.
template <int first, bool as_words>
__m256i order_of_weights() {
    constexpr char a = first, b = a + 1, c = a + 4, d = c + 1;
    const auto upper = [](char i) { return as_words ? char{-1} : i; };  // words: byte in the upper half
    return _mm256_setr_epi8(upper(a), a, upper(a), a, upper(a), a, upper(a), a, upper(b), b, upper(b), b, upper(b), b,
                            upper(b), b, upper(c), c, upper(c), c, upper(c), c, upper(c), c, upper(d), d, upper(d), d,
                            upper(d), d, upper(d), d);
}

__m256i load_fractions(const uint8_t* p) {
    int64_t fractions;
    std::memcpy(&fractions, p, 8);
    return _mm256_set1_epi64x(fractions);
}

// Store 8 pixels of 4 bytes, the first C of which are written.
template <int C>
struct Writer {
    __m256i order = in_register(duplicate_lane(_mm_setr_epi8(0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, -1, -1, -1, -1)));
    __m256i pixel_order = in_register(_mm256_setr_epi32(0, 1, 2, 4, 5, 6, 7, 7));

    void write(__m256i pixels, uint8_t* out) const {
        if constexpr (C == 4) {
            _mm256_storeu_si256(reinterpret_cast<__m256i*>(out), pixels);
        } else {
            const __m256i whole = _mm256_permutevar8x32_epi32(_mm256_shuffle_epi8(pixels, order), pixel_order);
            store16(out, _mm256_castsi256_si128(whole));
            _mm_storel_epi64(reinterpret_cast<__m128i*>(out + 16), _mm256_extracti128_si256(whole, 1));
        }
    }
};

// The arithmetic of linear_pixel: 16 values minus 128, as words, from 32 bytes in each row: pairs of adjacent
// neighbours.
struct Bilinear {
    __m256i sign = in_register(_mm256_set1_epi8(-128)), complement = in_register(_mm256_set1_epi16(0x00ff));
    __m256i weight = in_register(_mm256_set1_epi16(129 * 128)), one = in_register(_mm256_set1_epi16(LINEAR_ONE));
    __m256i round = in_register(_mm256_set1_epi16(256));

    // Fractions of x are in both bytes of a pair, those of y in the upper byte of a word.
    __m256i interpolate(__m256i fx, __m256i fy, __m256i upper_row, __m256i lower_row) const {
        const __m256i x = _mm256_xor_si256(fx, complement);
        const __m256i lower_weight = _mm256_mulhi_epu16(fy, weight), upper_weight = _mm256_sub_epi16(one, lower_weight);
        const __m256i upper = _mm256_maddubs_epi16(x, _mm256_xor_si256(upper_row, sign));
        const __m256i lower = _mm256_maddubs_epi16(x, _mm256_xor_si256(lower_row, sign));
        const __m256i sum =
            _mm256_add_epi16(_mm256_mulhrs_epi16(upper, upper_weight), _mm256_mulhrs_epi16(lower, lower_weight));
        return _mm256_mulhrs_epi16(sum, round);
    }

    __m256i bytes(__m256i first, __m256i second) const {
        return _mm256_xor_si256(_mm256_packs_epi16(first, second), sign);
    }
};

// Colour.
template <int C>
struct Linear {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;  // the last offset at which 8 bytes of both rows are readable
    Writer<C> writer;
    __m256i pairs = in_register(pairs_of_channels<C>());
    __m256i x_order_0 = in_register(order_of_weights<0, false>()),
            x_order_2 = in_register(order_of_weights<2, false>());
    __m256i y_order_0 = in_register(order_of_weights<0, true>()), y_order_2 = in_register(order_of_weights<2, true>());
    Bilinear bilinear;

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 8)) {}

    __m256i values(const uint8_t* row, const uint32_t* offsets) const {
        return _mm256_shuffle_epi8(load_row(row, offsets), pairs);
    }

    // 4 pixels. Both halves contain the fractions of all 8.
    __m256i sample_4(const uint32_t* offsets, __m256i fx, __m256i fy, __m256i across, __m256i down) const {
        return bilinear.interpolate(_mm256_shuffle_epi8(fx, across), _mm256_shuffle_epi8(fy, down),
                                    values(data, offsets), values(data + row_step, offsets));
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i x = load_fractions(b.fx), y = load_fractions(b.fy);
        const __m256i first = sample_4(b.offsets, x, y, x_order_0, y_order_0);
        const __m256i second = sample_4(b.offsets + 2, x, y, x_order_2, y_order_2);
        writer.write(bilinear.bytes(first, second), out);
    }
};

uint16_t load2(const uint8_t* p) {
    uint16_t pair;
    std::memcpy(&pair, p, 2);
    return pair;
}

// Both neighbours of 8 pixels of one channel.
__m128i load_grey(const uint8_t* row, const uint32_t* o) {
    __m128i a = _mm_cvtsi32_si128(load2(row + o[0])), b = _mm_cvtsi32_si128(load2(row + o[4]));
    a = _mm_insert_epi16(a, load2(row + o[1]), 1), b = _mm_insert_epi16(b, load2(row + o[5]), 1);
    a = _mm_insert_epi16(a, load2(row + o[2]), 2), b = _mm_insert_epi16(b, load2(row + o[6]), 2);
    a = _mm_insert_epi16(a, load2(row + o[3]), 3), b = _mm_insert_epi16(b, load2(row + o[7]), 3);
    return _mm_unpacklo_epi64(a, b);
}

template <>
struct Linear<1> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 2)) {}

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m128i sign = _mm_set1_epi8(-128), f = load8(b.fx);
        const __m128i x = _mm_xor_si128(_mm_unpacklo_epi8(f, f), _mm_set1_epi16(0x00ff));
        const __m128i lower_weight =
            _mm_mulhi_epu16(_mm_unpacklo_epi8(_mm_setzero_si128(), load8(b.fy)), _mm_set1_epi16(129 * 128));
        const __m128i upper_weight = _mm_sub_epi16(_mm_set1_epi16(LINEAR_ONE), lower_weight);
        const __m128i u = _mm_maddubs_epi16(x, _mm_xor_si128(load_grey(data, b.offsets), sign));
        const __m128i l = _mm_maddubs_epi16(x, _mm_xor_si128(load_grey(data + row_step, b.offsets), sign));
        const __m128i v = _mm_add_epi16(_mm_mulhrs_epi16(u, upper_weight), _mm_mulhrs_epi16(l, lower_weight));
        const __m128i values = _mm_mulhrs_epi16(v, _mm_set1_epi16(256));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_xor_si128(_mm_packs_epi16(values, values), sign));
    }
};

int load4(const uint8_t* p) {
    int four;
    std::memcpy(&four, p, 4);
    return four;
}

// Two channels, such as NV12 chroma: both neighbours of a pixel are 4 bytes.
template <>
struct Linear<2> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;
    __m256i pairs = in_register(duplicate_lane(_mm_setr_epi8(0, 2, 1, 3, 4, 6, 5, 7, 8, 10, 9, 11, 12, 14, 13, 15)));
    __m256i across = in_register(_mm256_setr_epi8(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5,
                                                  5, 6, 6, 6, 6, 7, 7, 7, 7));
    __m256i down = in_register(_mm256_setr_epi8(-1, 0, -1, 0, -1, 1, -1, 1, -1, 2, -1, 2, -1, 3, -1, 3, -1, 4, -1, 4,
                                                -1, 5, -1, 5, -1, 6, -1, 6, -1, 7, -1, 7));
    Bilinear bilinear;

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 4)) {}

    __m256i values(const uint8_t* row, const uint32_t* o) const {
        const __m256i pixels =
            _mm256_setr_epi32(load4(row + o[0]), load4(row + o[1]), load4(row + o[2]), load4(row + o[3]),
                              load4(row + o[4]), load4(row + o[5]), load4(row + o[6]), load4(row + o[7]));
        return _mm256_shuffle_epi8(pixels, pairs);
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i x = _mm256_shuffle_epi8(load_fractions(b.fx), across);
        const __m256i y = _mm256_shuffle_epi8(load_fractions(b.fy), down);
        const __m256i words = bilinear.interpolate(x, y, values(data, b.offsets), values(data + row_step, b.offsets));
        store16(out, _mm256_castsi256_si128(_mm256_permute4x64_epi64(bilinear.bytes(words, words), 0x08)));
    }
};

}  // namespace
}  // namespace omnimirror
