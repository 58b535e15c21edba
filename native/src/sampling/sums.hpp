// Sums of cubic samples of a pixel, and their mean: (1/n) sum_k f(p_k) over the n taps p_k inside the image.
#pragma once

#include "tiles.hpp"

namespace omnimirror {
namespace {

// Sums of uint8 images have 7 fractional bits; others are float.
template <class T>
struct SumOf {
    using type = float;
};
template <>
struct SumOf<uint8_t> {
    using type = int32_t;
};
template <class T>
using Sum = typename SumOf<T>::type;
constexpr float SUM_ONE = 128;

// The sums of 8 pixels are contiguous, in the order of the vector kernels: plain order for one and two channels;
// otherwise 4 values per pixel, pixels in the order 0, 4, 1, 5, 2, 6, 3, 7.
template <int C>
constexpr int CHANNELS_OF_SUMS = C > 2 ? 4 : C;
template <int C>
constexpr int place_of_sum(int i) {
    return C > 2 ? i / 8 * 32 + i % 4 * 8 + i % 8 / 4 * 4 : i * C;
}

// Add the taps inside the image, of up to 8 pixels, and count them.
template <int C, class T>
void add_8_taps(const Source& s, const Block<Fraction<T>>& b, Sum<T>* sums, uint16_t* inside) {
    for (int i = 0; i < 8; ++i) {
        if (b.offsets[i] == OUTSIDE) continue;
        ++inside[i];
        Sum<T>* at = sums + place_of_sum<C>(i);
        any_cubic_pixel<C, T>(s, b.offsets[i], b.fx[i], b.fy[i], [at](int c, Sum<T> sum) {
            if constexpr (sizeof(T) == 1)
                at[c] += sum >> 13;
            else
                at[c] += sum;
        });
    }
}

template <class T>
T mean_of(Sum<T> sum, int count) {
    if constexpr (sizeof(T) == 1)
        return round_to<T>(static_cast<float>(sum) * (1 / (SUM_ONE * static_cast<float>(count))));
    else
        return round_to<T>(sum * (1 / static_cast<float>(count)));
}

struct PlainSums {
    // count is a multiple of 8.
    template <int C, class T>
    static void add_taps(const Source& source, const Block<Fraction<T>>* blocks, int count, Sum<T>* sums,
                         uint16_t* inside) {
        for (int i = 0; i < count; i += 8)
            add_8_taps<C, T>(source, blocks[i / 8], sums + i * CHANNELS_OF_SUMS<C>, inside + i);
    }

    template <int C, class T>
    static void mean_of_8(const Sum<T>* sums, int count, T* out) {
        for (int i = 0; i < 8; ++i)
            for (int c = 0; c < C; ++c) out[i * C + c] = mean_of<T>(sums[place_of_sum<C>(i) + c], count);
    }
};

}  // namespace
}  // namespace omnimirror
