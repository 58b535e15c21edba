// Samples of uint8 images with one or two channels, such as luma and chroma of YUV, for 64-bit ARM.
#pragma once

#include <arm_neon.h>

#include "pixel.hpp"

namespace omnimirror {
namespace {

inline uint16_t two_bytes(const uint8_t* p) {
    uint16_t v;
    std::memcpy(&v, p, 2);
    return v;
}

inline uint32_t four_bytes(const uint8_t* p) {
    uint32_t v;
    std::memcpy(&v, p, 4);
    return v;
}

// The fraction of a pixel for each of its channels: 8 pixels, or the first 4 repeated.
template <int C>
uint8x8_t per_channel(const uint8_t* fractions) {
    if constexpr (C == 1) return vld1_u8(fractions);
    const uint8x8_t four = vreinterpret_u8_u32(vdup_n_u32(four_bytes(fractions)));
    return vzip1_u8(four, four);
}

// Both neighbours in a row, of as many pixels as yield 8 values.
struct Neighbours {
    uint8x8_t left, right;
};

template <int C>
Neighbours neighbours(const uint8_t* row, const uint32_t* o);

template <>
inline Neighbours neighbours<1>(const uint8_t* row, const uint32_t* o) {
    uint16_t pairs[8];
    for (int i = 0; i < 8; ++i) pairs[i] = two_bytes(row + o[i]);
    const uint16x8_t v = vld1q_u16(pairs);
    return {vmovn_u16(v), vshrn_n_u16(v, 8)};
}

template <>
inline Neighbours neighbours<2>(const uint8_t* row, const uint32_t* o) {
    uint32_t pairs[4];
    for (int i = 0; i < 4; ++i) pairs[i] = four_bytes(row + o[i]);
    const uint32x4_t v = vld1q_u32(pairs);
    return {vreinterpret_u8_u16(vmovn_u32(v)), vreinterpret_u8_u16(vshrn_n_u32(v, 16))};
}

// The arithmetic of linear_pixel, 8 values at a time.
template <int C>
struct NarrowLinear {
    static constexpr int AT_ONCE = 8 / C;
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit NarrowLinear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 2 * C)) {}

    static int16x8_t across(const Neighbours& n, uint8x8_t fx) {
        const uint16x8_t sum = vmlal_u8(vmull_u8(n.left, vmvn_u8(fx)), n.right, fx);
        return vreinterpretq_s16_u16(vsubq_u16(sum, vdupq_n_u16(128 * 255)));
    }

    void sample(const uint32_t* offsets, const uint8_t* fx, const uint8_t* fy, uint8_t* out) const {
        const uint8x8_t x = per_channel<C>(fx);
        const int16x8_t upper = across(neighbours<C>(data, offsets), x);
        const int16x8_t lower = across(neighbours<C>(data + row_step, offsets), x);
        const uint16x8_t down = vshrq_n_u16(vmull_u8(per_channel<C>(fy), vdup_n_u8(129)), 1);
        const int16x8_t weight = vreinterpretq_s16_u16(down);
        const int16x8_t u = vqrdmulhq_s16(upper, vsubq_s16(vdupq_n_s16(LINEAR_ONE), weight));
        const int16x8_t v = vaddq_s16(u, vqrdmulhq_s16(lower, weight));
        vst1_u8(out, vqmovun_s16(vaddq_s16(vrshrq_n_s16(v, 7), vdupq_n_s16(128))));
    }
};

// The arithmetic of cubic_sum: each pixel in four parts, which sum to its channels.
template <int C>
struct NarrowCubic {
    static constexpr int AT_ONCE = 4;
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit NarrowCubic(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - 2 * row_step - 3 * C)) {}

    static uint16x4_t lattice_cursor(uint16x4_t values, uint32_t magnitude) {
        return vshrn_n_u32(vmull_n_u16(values, static_cast<uint16_t>(magnitude)), 8);
    }

    // Values of four rows in 4 columns.
    static int16x4_t down(const uint16x4_t* rows, const uint32_t* wy) {
        const uint16x4_t inner = vadd_u16(lattice_cursor(rows[1], wy[1]), lattice_cursor(rows[2], wy[2]));
        return vreinterpret_s16_u16(
            vsub_u16(inner, vadd_u16(lattice_cursor(rows[0], wy[0]), lattice_cursor(rows[3], wy[3]))));
    }

    int32x4_t parts(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const uint8_t* first = data + offset - row_step - C;
        const uint32_t* wy = CUBIC.magnitudes[fy];
        const int16x4_t wx = vld1_s16(CUBIC.weights[fx]);
        uint16x4_t low[4], high[4];
        for (int j = 0; j < 4; ++j) {
            const uint8_t* row = first + j * row_step;
            const uint8x8_t bytes = C == 1 ? vreinterpret_u8_u32(vdup_n_u32(four_bytes(row))) : vld1_u8(row);
            const uint16x8_t values = vmovl_u8(bytes);
            low[j] = vget_low_u16(values), high[j] = vget_high_u16(values);
        }
        if constexpr (C == 1) return vmull_s16(down(low, wy), wx);
        const int32x4_t near = vmull_s16(down(low, wy), vzip1_s16(wx, wx));
        return vmlal_s16(near, down(high, wy), vzip2_s16(wx, wx));
    }

    // With 20 fractional bits: 4 pixels of one channel, or 2 pixels of two.
    int32x4_t sums(const uint32_t* o, const uint8_t* fx, const uint8_t* fy) const {
        const auto at = [&](int i) { return parts(o[i], fx[i], fy[i]); };
        if constexpr (C == 1) return vpaddq_s32(vpaddq_s32(at(0), at(1)), vpaddq_s32(at(2), at(3)));
        const auto both = [](int32x4_t v) { return vadd_s32(vget_low_s32(v), vget_high_s32(v)); };
        return vcombine_s32(both(at(0)), both(at(1)));
    }

    void add_8(const Block<uint8_t>& b, int32_t* all) const {
        for (int i = 0; i < 8; i += 4 / C) {
            int32_t* at = all + i * C;
            vst1q_s32(at, vaddq_s32(vld1q_s32(at), vshrq_n_s32(sums(b.offsets + i, b.fx + i, b.fy + i), 13)));
        }
    }

    void sample(const uint32_t* o, const uint8_t* fx, const uint8_t* fy, uint8_t* out) const {
        const auto words = [&](int i) {
            return vqmovn_s32(vshrq_n_s32(vaddq_s32(sums(o + i, fx + i, fy + i), vdupq_n_s32(1 << 19)), 20));
        };
        const int16x4_t first = words(0), second = C == 1 ? first : words(2);
        const uint8x8_t bytes = vqmovun_s16(vcombine_s16(first, second));
        std::memcpy(out, &bytes, 4 * C);
    }
};

}  // namespace
}  // namespace omnimirror
