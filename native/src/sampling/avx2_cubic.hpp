// Bicubic samples of uint8 images, 8 pixels at a time.
#pragma once

#include "avx2_linear.hpp"

namespace omnimirror {
namespace {

void add_to(int32_t* sums, __m256i more) {
    _mm256_store_si256(reinterpret_cast<__m256i*>(sums), _mm256_add_epi32(load32(sums), more));
}

// Words in both halves: channels of taps 0 and 1 interleaved, and of taps 2 and 3; the byte is in the upper half.
template <int C>
__m256i pairs_of_taps() {
    const auto half = [](char k) {
        const char a = k * C, b = a + C;
        constexpr char d = C == 4 ? 3 : 2, z = -1;
        return _mm_setr_epi8(z, a, z, b, z, a + 1, z, b + 1, z, a + 2, z, b + 2, z, a + d, z, b + d);
    };
    return _mm256_set_m128i(half(2), half(0));
}

// Colour. See cubic_sum for the arithmetic.
template <int C>
struct Cubic {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;  // the last offset at which the lowest row's 16 bytes are readable
    Writer<C> writer;
    __m256i order = in_register(pairs_of_taps<C>());
    __m256i spread = in_register(_mm256_setr_epi8(0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 4, 5, 6, 7, 4, 5, 6,
                                                  7, 4, 5, 6, 7, 4, 5, 6, 7));
    __m256i round = in_register(_mm256_set1_epi32(1 << 19));

    explicit Cubic(const Source& s)
        : data(s.data),
          row_step(s.geometry.row_step),
          last(static_cast<uint32_t>(s.elements - 2 * row_step + C - 16)) {}

    __m256i weighted(const uint8_t* row, uint32_t magnitude) const {
        const __m256i values = _mm256_shuffle_epi8(duplicate_lane(load16(row)), order);
        return _mm256_mulhi_epu16(values, _mm256_set1_epi32(static_cast<int>(magnitude)));
    }

    // Sums of taps 0 and 1 and of taps 2 and 3 of one pixel, with 20 fractional bits.
    __m256i halves(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - C;
        const uint32_t* wy = CUBIC.magnitudes[fy];
        const __m256i minus = _mm256_add_epi16(weighted(first, wy[0]), weighted(first + 3 * row_step, wy[3]));
        const __m256i plus = _mm256_add_epi16(weighted(first + row_step, wy[1]), weighted(first + 2 * row_step, wy[2]));
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm256_madd_epi16(_mm256_sub_epi16(plus, minus), _mm256_shuffle_epi8(_mm256_set1_epi64x(wx), spread));
    }

    // Pixels i and i + 4, 32 bits per channel.
    __m256i sum_2(const Block<uint8_t>& block, int i) const {
        const __m256i a = halves(block.offsets[i], block.fx[i], block.fy[i]);
        const __m256i b = halves(block.offsets[i + 4], block.fx[i + 4], block.fy[i + 4]);
        return _mm256_add_epi32(_mm256_permute2x128_si256(a, b, 0x20), _mm256_permute2x128_si256(a, b, 0x31));
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const {
        for (int i = 0; i < 4; ++i) add_to(sums + 8 * i, _mm256_srai_epi32(sum_2(b, i), 13));
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const auto at = [&](int i) { return _mm256_srai_epi32(_mm256_add_epi32(sum_2(b, i), round), 20); };
        const __m256i first = _mm256_packs_epi32(at(0), at(1)), second = _mm256_packs_epi32(at(2), at(3));
        writer.write(_mm256_packus_epi16(first, second), out);
    }
};

// Grey: the 16 taps of a pixel fill one register.
template <>
struct Cubic<1> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Cubic(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - 2 * row_step + 1 - 4)) {}

    // Four word sums whose total is one pixel.
    __m128i one_pixel(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - 1;
        const __m128i bytes = _mm_setr_epi32(load4(first), load4(first + row_step), load4(first + 2 * row_step),
                                             load4(first + 3 * row_step));
        const __m256i values = _mm256_slli_epi16(_mm256_cvtepu8_epi16(bytes), 8);  // rows 0, 1 and rows 2, 3
        const __m256i rows = _mm256_setr_epi32(0, 0, 1, 1, 2, 2, 3, 3);
        const __m256i wy = _mm256_permutevar8x32_epi32(duplicate_lane(load16(CUBIC.magnitudes[fy])), rows);
        const __m256i weighted = _mm256_mulhi_epu16(values, wy);
        const __m128i low = _mm256_castsi256_si128(weighted), high = _mm256_extracti128_si256(weighted, 1);
        // rows 1 - 0 and 2 - 3
        const __m128i inner_rows = _mm_unpackhi_epi64(low, _mm_slli_si128(high, 8));
        const __m128i outer_rows = _mm_unpacklo_epi64(low, _mm_srli_si128(high, 8));
        const __m128i columns = _mm_sub_epi16(inner_rows, outer_rows);
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm_madd_epi16(columns, _mm_set1_epi64x(wx));
    }

    __m256i sum_8(const Block<uint8_t>& b) const {
        const auto at = [&](int i) { return one_pixel(b.offsets[i], b.fx[i], b.fy[i]); };
        const __m128i first = _mm_hadd_epi32(_mm_hadd_epi32(at(0), at(1)), _mm_hadd_epi32(at(2), at(3)));
        const __m128i second = _mm_hadd_epi32(_mm_hadd_epi32(at(4), at(5)), _mm_hadd_epi32(at(6), at(7)));
        return _mm256_set_m128i(second, first);
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const { add_to(sums, _mm256_srai_epi32(sum_8(b), 13)); }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m256i sum = _mm256_srai_epi32(_mm256_add_epi32(sum_8(b), _mm256_set1_epi32(1 << 19)), 20);
        const __m128i words = _mm_packs_epi32(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(out), _mm_packus_epi16(words, words));
    }
};

// Two channels: a row's taps are 8 bytes.
template <>
struct Cubic<2> {
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Cubic(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - 2 * row_step + 2 - 8)) {}

    static __m128i weighted(const uint8_t* row, uint32_t magnitude) {
        const __m128i values = _mm_unpacklo_epi8(_mm_setzero_si128(), load8(row));
        return _mm_mulhi_epu16(values, _mm_set1_epi32(static_cast<int>(magnitude)));
    }

    // Four word sums: two of the first channel and two of the second.
    __m128i one_pixel(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - 2;
        const uint32_t* wy = CUBIC.magnitudes[fy];
        const __m128i minus = _mm_add_epi16(weighted(first, wy[0]), weighted(first + 3 * row_step, wy[3]));
        const __m128i plus = _mm_add_epi16(weighted(first + row_step, wy[1]), weighted(first + 2 * row_step, wy[2]));
        const __m128i channel_order = _mm_setr_epi8(0, 1, 4, 5, 8, 9, 12, 13, 2, 3, 6, 7, 10, 11, 14, 15);
        int64_t wx;
        std::memcpy(&wx, CUBIC.weights[fx], 8);
        return _mm_madd_epi16(_mm_shuffle_epi8(_mm_sub_epi16(plus, minus), channel_order), _mm_set1_epi64x(wx));
    }

    __m128i sum_2(const Block<uint8_t>& b, int i) const {
        return _mm_hadd_epi32(one_pixel(b.offsets[i], b.fx[i], b.fy[i]),
                              one_pixel(b.offsets[i + 1], b.fx[i + 1], b.fy[i + 1]));
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const {
        for (int i = 0; i < 8; i += 4)
            add_to(sums + 2 * i, _mm256_srai_epi32(_mm256_set_m128i(sum_2(b, i + 2), sum_2(b, i)), 13));
    }

    void sample_8(const Block<uint8_t>& b, uint8_t* out) const {
        const __m128i round = _mm_set1_epi32(1 << 19);
        const auto two = [&](int i) { return _mm_srai_epi32(_mm_add_epi32(sum_2(b, i), round), 20); };
        const __m128i first = _mm_packs_epi32(two(0), two(2)), second = _mm_packs_epi32(two(4), two(6));
        store16(out, _mm_packus_epi16(first, second));
    }
};

}  // namespace
}  // namespace omnimirror
