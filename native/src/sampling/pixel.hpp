// Image value at one position, in plain C++: see common.hpp. At (x0 + t, y0 + s), t and s in [0, 1],
//   linear:  sum of (1 - t, t)_i (1 - s, s)_j f(x0 + i, y0 + j), i and j from 0 to 1
//   cubic:   sum of w_i(t) w_j(s) f(x0 + i, y0 + j), i and j from -1 to 2, w the weights below
#pragma once

#include "common.hpp"

namespace omnimirror {
namespace {

// Weights of the two inner taps (>= 0) and absolute weights of the two outer taps; the signed weights sum to 1. Keys'
// kernel with a = -0.75, as in OpenCV.
template <class Real>
constexpr void cubic_weights(Real t, Real (&w)[4]) {
    const Real a = Real(0.75), s = 1 - t;
    w[0] = a * t * s * s;
    w[3] = a * s * t * t;
    w[1] = ((2 - a) * t - (3 - a)) * t * t + 1;
    w[2] = 1 + w[0] + w[3] - w[1];
}

struct CubicTable {
    int16_t weights[256][4];      // signed; 16384 is 1 and the sum of each row
    uint32_t magnitudes[256][4];  // absolute values, repeated in both halves of 32 bits
};

constexpr CubicTable cubic_table() {
    CubicTable table{};
    for (int f = 0; f < 256; ++f) {
        double w[4]{};
        cubic_weights(f / 255.0, w);
        int q[4]{};
        for (int k = 0; k < 4; ++k) q[k] = static_cast<int>(w[k] * 16384 + 0.5);
        (f < 128 ? q[1] : q[2]) += 16384 - (q[1] + q[2] - q[0] - q[3]);
        for (int k = 0; k < 4; ++k) {
            const bool outer = k == 0 || k == 3;
            table.weights[f][k] = static_cast<int16_t>(outer ? -q[k] : q[k]);
            table.magnitudes[f][k] = static_cast<uint32_t>(q[k]) * 0x10001u;
        }
    }
    return table;
}

alignas(64) constexpr CubicTable CUBIC = cubic_table();

// Vertical weights of uint8 images: fractions of 255 times 64.5. Twice 255 * 128 * 16448 / 2^15 is then a value with 7
// fractional bits, in 16 bits.
constexpr int LINEAR_ONE = 16448;
constexpr int linear_weight(int fy) { return (fy * 129) >> 1; }
constexpr int multiply_high(int a, int b) { return (a * b + 0x4000) >> 15; }  // as pmulhrsw and sqrdmulh
constexpr uint8_t clamp8(int v) { return static_cast<uint8_t>(v < 0 ? 0 : v > 255 ? 255 : v); }

template <class T>
T round_to(float v) {
    if constexpr (sizeof(T) == 4) return v;
    constexpr float maximum = sizeof(T) == 1 ? 255.0f : 65535.0f;
    v = v > 0 ? v : 0;
    v = v < maximum ? v : maximum;
    return static_cast<T>(v + 0.5f);
}
template <>
float round_to<float>(float v) {
    return v;
}

// One uint8 pixel; equal to the vector kernels bit by bit.
template <int C>
void linear_pixel(const Source& s, uint32_t offset, uint8_t fx, uint8_t fy, uint8_t* out) {
    const uint8_t *upper = s.data + offset, *lower = upper + s.geometry.row_step;
    const int w1 = linear_weight(fy), w0 = LINEAR_ONE - w1;
    for (int c = 0; c < C; ++c) {
        const int u = upper[c] * (255 - fx) + upper[C + c] * fx - 128 * 255;
        const int l = lower[c] * (255 - fx) + lower[C + c] * fx - 128 * 255;
        out[c] = clamp8(multiply_high(multiply_high(u, w0) + multiply_high(l, w1), 256) + 128);
    }
}

template <int C, class T>
void linear_pixel(const Source& s, uint32_t offset, uint16_t fx, uint16_t fy, T* out) {
    const T *upper = reinterpret_cast<const T*>(s.data) + offset, *lower = upper + s.geometry.row_step;
    const float x = static_cast<float>(fx) / 65535, y = static_cast<float>(fy) / 65535;
    for (int c = 0; c < C; ++c) {
        const float u = static_cast<float>(upper[c]) * (1 - x) + static_cast<float>(upper[C + c]) * x;
        const float l = static_cast<float>(lower[c]) * (1 - x) + static_cast<float>(lower[C + c]) * x;
        out[c] = round_to<T>(u * (1 - y) + l * y);
    }
}

// Weighted sum of four rows at four taps, one channel: 20 fractional bits.
int cubic_sum(const uint8_t (&taps)[4][4], uint8_t fx, uint8_t fy) {
    int sum = 0;
    for (int k = 0; k < 4; ++k) {
        int column = 0;
        for (int j = 0; j < 4; ++j) {
            const int magnitude = static_cast<int>(CUBIC.magnitudes[fy][j] & 0xffff);
            const int product = (taps[j][k] * 256 * magnitude) >> 16;
            column += j == 1 || j == 2 ? product : -product;
        }
        sum += column * CUBIC.weights[fx][k];
    }
    return sum;
}

template <class T>
float cubic_sum(const T (&taps)[4][4], uint16_t fx, uint16_t fy) {
    float wx[4], wy[4], sum = 0;
    cubic_weights(static_cast<float>(fx) / 65535, wx);
    cubic_weights(static_cast<float>(fy) / 65535, wy);
    wx[0] = -wx[0], wx[3] = -wx[3], wy[0] = -wy[0], wy[3] = -wy[3];
    for (int j = 0; j < 4; ++j)
        sum += wy[j] * (wx[0] * static_cast<float>(taps[j][0]) + wx[1] * static_cast<float>(taps[j][1]) +
                        wx[2] * static_cast<float>(taps[j][2]) + wx[3] * static_cast<float>(taps[j][3]));
    return sum;
}

template <class T, class Sum>
T rounded_cubic(Sum sum) {
    if constexpr (sizeof(T) == 1)
        return clamp8((sum + (1 << 19)) >> 20);
    else
        return round_to<T>(sum);
}

// One pixel whose taps may be outside the image: the edge is replicated. Passes the sum of each channel to take(c,
// sum).
template <int C, class T, class F, class Take>
void cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, Take take) {
    const Geometry& g = s.geometry;
    const T* data = reinterpret_cast<const T*>(s.data);
    const int y0 = static_cast<int>(offset / g.row_step), x0 = static_cast<int>(offset % g.row_step / C);
    for (int c = 0; c < C; ++c) {
        T taps[4][4];
        for (int j = 0; j < 4; ++j) {
            const int y = min_of(max_of(y0 - 1 + j, 0), g.y0_max + 1);
            const T* row = data + static_cast<ptrdiff_t>(y) * g.row_step + c;
            for (int k = 0; k < 4; ++k) taps[j][k] = row[min_of(max_of(x0 - 1 + k, 0), g.x0_max + 1) * C];
        }
        take(c, cubic_sum(taps, fx, fy));
    }
}

template <int C, class T, class F, class Take>
void inner_cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, Take take) {
    const ptrdiff_t row_step = s.geometry.row_step;
    const T* first = reinterpret_cast<const T*>(s.data) + offset - row_step - C;
    for (int c = 0; c < C; ++c) {
        T taps[4][4];
        for (int j = 0; j < 4; ++j)
            for (int k = 0; k < 4; ++k) taps[j][k] = first[j * row_step + k * C + c];
        take(c, cubic_sum(taps, fx, fy));
    }
}

template <int C, class T, class F, class Take>
void any_cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, Take take) {
    if (offset & EDGE)
        cubic_pixel<C, T>(s, offset & ~EDGE, fx, fy, take);
    else
        inner_cubic_pixel<C, T>(s, offset, fx, fy, take);
}

template <Interpolation I, int C, class T, class F>
void sample_pixel(const Job& job, uint32_t offset, F fx, F fy, T* out) {
    if (offset == OUTSIDE)
        std::memcpy(out, job.border, C * sizeof(T));
    else if constexpr (I == Interpolation::nearest)
        std::memcpy(out, reinterpret_cast<const T*>(job.source.data) + offset, C * sizeof(T));
    else if constexpr (I == Interpolation::linear)
        linear_pixel<C>(job.source, offset, fx, fy, out);
    else
        any_cubic_pixel<C, T>(job.source, offset, fx, fy,
                              [out](int c, auto sum) { out[c] = rounded_cubic<T>(sum); });
}

}  // namespace
}  // namespace omnimirror
