// Kernels for 64-bit ARM. The results equal those of linear_pixel and cubic_sum bit by bit.
#include <arm_neon.h>

#include <type_traits>

#include "axial_kernel.hpp"
#include "footprint.hpp"
#include "neon_narrow.hpp"

namespace omnimirror {
namespace {

// Store 4 pixels of 4 bytes, the first C of which are written.
template <int C>
void store_4(uint8x16_t pixels, uint8_t* out) {
    if constexpr (C == 4) {
        vst1q_u8(out, pixels);
    } else {
        static const uint8_t order[16] = {0, 1, 2, 4, 5, 6, 8, 9, 10, 12, 13, 14, 255, 255, 255, 255};
        const uint8x16_t whole = vqtbl1q_u8(pixels, vld1q_u8(order));
        vst1_u8(out, vget_low_u8(whole));
        const uint32_t end = vgetq_lane_u32(vreinterpretq_u32_u8(whole), 2);
        std::memcpy(out + 8, &end, 4);
    }
}

// Loads read 8 or 16 bytes of a row; they are valid at offsets up to last.
template <int C>
struct Linear {
    static constexpr int AT_ONCE = 4;
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Linear(const Source& s)
        : data(s.data), row_step(s.geometry.row_step), last(static_cast<uint32_t>(s.elements - row_step - 8)) {}

    // One row of one pixel, minus 128, times 255; the first 4 of 8 words are used.
    static int16x4_t across(const uint8_t* row, uint8_t fx) {
        const uint8x8_t left = vld1_u8(row);
        const uint8x8_t right = vext_u8(left, left, C);
        uint16x8_t sum = vmull_u8(left, vdup_n_u8(static_cast<uint8_t>(255 - fx)));
        sum = vmlal_u8(sum, right, vdup_n_u8(fx));
        return vreinterpret_s16_u16(vsub_u16(vget_low_u16(sum), vdup_n_u16(128 * 255)));
    }

    int16x4_t pixel(uint32_t offset, uint8_t fx, uint8_t fy) const {
        const int16_t lower = static_cast<int16_t>(linear_weight(fy)), upper = static_cast<int16_t>(LINEAR_ONE - lower);
        const int16x4_t u = vqrdmulh_n_s16(across(data + offset, fx), upper);
        return vadd_s16(u, vqrdmulh_n_s16(across(data + offset + row_step, fx), lower));
    }

    // Two pixels of 4 bytes.
    uint8x8_t two(const uint32_t* offsets, const uint8_t* fx, const uint8_t* fy) const {
        const int16x8_t v = vcombine_s16(pixel(offsets[0], fx[0], fy[0]), pixel(offsets[1], fx[1], fy[1]));
        const int16x8_t rounded = vaddq_s16(vrshrq_n_s16(v, 7), vdupq_n_s16(128));
        return vqmovun_s16(rounded);
    }

    void sample(const uint32_t* o, const uint8_t* fx, const uint8_t* fy, uint8_t* out) const {
        store_4<C>(vcombine_u8(two(o, fx, fy), two(o + 2, fx + 2, fy + 2)), out);
    }
};

template <int C>
struct Cubic {
    static constexpr int AT_ONCE = 4;
    const uint8_t* data;
    ptrdiff_t row_step;
    uint32_t last;

    explicit Cubic(const Source& s)
        : data(s.data),
          row_step(s.geometry.row_step),
          last(static_cast<uint32_t>(s.elements - 2 * row_step + C - 16)) {}

    // Bytes of a row times a weight, without the lowest 8 bits, as 8 words from byte 0 or 8.
    static uint16x8_t weighted_bytes(uint8x8_t bytes, uint32_t magnitude) {
        const uint16x8_t values = vshll_n_u8(bytes, 8 - 1), doubled = vaddq_u16(values, values);
        const uint16_t weight = static_cast<uint16_t>(magnitude);
        const uint16x4_t low = vshrn_n_u32(vmull_n_u16(vget_low_u16(doubled), weight), 16);
        return vcombine_u16(low, vshrn_n_u32(vmull_n_u16(vget_high_u16(doubled), weight), 16));
    }

    struct Columns {
        int16x8_t low, high;
    };

    static Columns columns(const uint8_t* first, ptrdiff_t row_step, const uint32_t* wy) {
        int16x8_t halves[2];
        for (int h = 0; h < 2; ++h) {
            const auto row = [&](int j) { return weighted_bytes(vld1_u8(first + j * row_step + 8 * h), wy[j]); };
            const uint16x8_t inner = vaddq_u16(row(1), row(2)), outer = vaddq_u16(row(0), row(3));
            halves[h] = vreinterpretq_s16_u16(vsubq_u16(inner, outer));
        }
        return {halves[0], halves[1]};
    }

    // With 20 fractional bits, added to an initial value.
    static int32x4_t sum(const uint8_t* inner, ptrdiff_t row_step, uint8_t fx, uint8_t fy, int beginning) {
        const Columns v = columns(inner - row_step - C, row_step, CUBIC.magnitudes[fy]);
        const int16_t* w = CUBIC.weights[fx];
        const int16x4_t tap1 = vget_low_s16(vextq_s16(v.low, v.high, C));
        const int16x4_t tap2 = C == 4 ? vget_low_s16(v.high) : vget_low_s16(vextq_s16(v.low, v.high, 6));
        const int16x4_t tap3 = C == 4 ? vget_high_s16(v.high) : vget_low_s16(vextq_s16(v.high, v.high, 1));
        int32x4_t total = vmlal_n_s16(vdupq_n_s32(beginning), vget_low_s16(v.low), w[0]);
        total = vmlal_n_s16(total, tap1, w[1]);
        total = vmlal_n_s16(total, tap2, w[2]);
        return vmlal_n_s16(total, tap3, w[3]);
    }

    void add_8(const Block<uint8_t>& b, int32_t* sums) const {
        for (int i = 0; i < 8; ++i) {
            int32_t* at = sums + place_of_sum<C>(i);
            const int32x4_t more = vshrq_n_s32(sum(data + b.offsets[i], row_step, b.fx[i], b.fy[i], 0), 13);
            vst1q_s32(at, vaddq_s32(vld1q_s32(at), more));
        }
    }

    void sample(const uint32_t* offsets, const uint8_t* fx, const uint8_t* fy, uint8_t* out) const {
        const auto at = [&](int i) {
            return vqmovn_s32(vshrq_n_s32(sum(data + offsets[i], row_step, fx[i], fy[i], 1 << 19), 20));
        };
        const uint8x8_t first = vqmovun_s16(vcombine_s16(at(0), at(1))), second = vqmovun_s16(vcombine_s16(at(2), at(3)));
        store_4<C>(vcombine_u8(first, second), out);
    }
};

template <class Kernel, Interpolation I, int C>
void sample_by_kernel(const Job& job, const Strip<uint8_t>& s) {
    constexpr int AT_ONCE = Kernel::AT_ONCE;
    const Kernel kernel(job.source);
    const uint32x4_t last = vdupq_n_u32(kernel.last);
    for (int i = 0; i < s.count; i += AT_ONCE) {
        const Block<uint8_t>& b = s.blocks[i / 8];
        const int half = i % 8, count = min_of(AT_ONCE, s.count - i);
        const uint32_t* o = b.offsets + half;
        const uint32x4_t maximum = vmaxq_u32(vld1q_u32(o), vld1q_u32(o + AT_ONCE - 4));
        if (count == AT_ONCE && !vmaxvq_u32(vcgtq_u32(maximum, last))) {
            kernel.sample(o, b.fx + half, b.fy + half, s.out + i * C);
        } else {
            for (int k = 0; k < count; ++k)
                sample_pixel<I, C>(job, o[k], b.fx[half + k], b.fy[half + k], s.out + (i + k) * C);
        }
    }
}

template <int C>
using LinearOf = std::conditional_t<(C > 2), Linear<C>, NarrowLinear<C>>;
template <int C>
using CubicOf = std::conditional_t<(C > 2), Cubic<C>, NarrowCubic<C>>;

struct Neon : Plain {
    template <Interpolation I, int C, class T>
    static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        if constexpr (sizeof(T) == 1 && I == Interpolation::linear)
            sample_by_kernel<LinearOf<C>, I, C>(job, s);
        else if constexpr (sizeof(T) == 1 && I == Interpolation::cubic)
            sample_by_kernel<CubicOf<C>, I, C>(job, s);
        else
            Plain::sample_strip<I, C, T>(job, s);
    }
};

struct NeonSums : PlainSums {
    template <int C, class T>
    static void add_taps(const Source& source, const Block<Fraction<T>>* blocks, int count, Sum<T>* sums,
                         uint16_t* inside) {
        if constexpr (sizeof(T) == 1) {
            const CubicOf<C> kernel(source);
            const uint32x4_t last = vdupq_n_u32(kernel.last);
            for (int i = 0; i < count; i += 8) {
                const Block<uint8_t>& b = blocks[i / 8];
                const uint32x4_t maximum = vmaxq_u32(vld1q_u32(b.offsets), vld1q_u32(b.offsets + 4));
                if (vmaxvq_u32(vcgtq_u32(maximum, last))) {
                    add_8_taps<C, T>(source, b, sums + i * CHANNELS_OF_SUMS<C>, inside + i);
                    continue;
                }
                kernel.add_8(b, sums + i * CHANNELS_OF_SUMS<C>);
                vst1q_u16(inside + i, vaddq_u16(vld1q_u16(inside + i), vdupq_n_u16(1)));
            }
        } else {
            PlainSums::add_taps<C, T>(source, blocks, count, sums, inside);
        }
    }
};

}  // namespace

const Kernels neon_kernels{"neon", Level::PLAIN, &sample<Neon>, &average<Neon, NeonSums>, &pack<Neon>, &project_targets};

}  // namespace omnimirror
