// The kernels in plain C++, and what they share with those for one instruction set.
//
// Everything here has internal linkage: this file is compiled once per instruction set, and the linker must
// never pick a function that was compiled for another one. For the same reason nothing of the standard
// library that has a body is called.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>

#include "job.hpp"

namespace omnimirror {
namespace {

template <class T> T smaller(T a, T b) { return b < a ? b : a; }
template <class T> T larger(T a, T b) { return a < b ? b : a; }

// Fractions of deep pictures are finer: 1/65535 of a pixel instead of 1/255. A fraction of 1 occurs, at the
// last pixel, which has no right or lower neighbour.
template <class T> struct FractionOf { using type = uint16_t; };
template <> struct FractionOf<uint8_t> { using type = uint8_t; };
template <class T> using Fraction = typename FractionOf<T>::type;
template <class F> constexpr int one = sizeof(F) == 1 ? 255 : 65535;

constexpr int round_up8(int n) { return (n + 7) & ~7; }

// -- where output pixels look ----------------------------------------------------------------------

template <class F> struct Taps {
    alignas(64) uint32_t offsets[STRIP];
    alignas(64) F fx[STRIP];
    alignas(64) F fy[STRIP];
};

// Up to STRIP adjoining output pixels. Entries up to the next multiple of 8 can be read, and are harmless.
template <class F> struct Strip {
    const uint32_t* offsets;
    const F *fx, *fy;
    int count;
    uint8_t* out;
    const uint32_t* ahead;  // offsets that are wanted soon, as many, or nullptr
};

// Coordinates to offsets and fractions; x and y hold count, a multiple of 8. Written so that compilers
// vectorise it: no branches, and comparisons that are false for NaN.
template <Interpolation I, class Real, class F>
void locate(const Real* __restrict x, const Real* __restrict y, int count, const Geometry& g,
            uint32_t* __restrict offsets, F* __restrict fx, F* __restrict fy) {
    const Real right = static_cast<Real>(g.width - 0.5), bottom = static_cast<Real>(g.height - 0.5);
    const Real x_last = static_cast<Real>(g.width - 1), y_last = static_cast<Real>(g.height - 1);
    const Real scale = one<F>, half = static_cast<Real>(0.5);
    const int x0_max = g.x0_max, y0_max = g.y0_max;
    const int x_inner = g.x_inner, y_inner = g.y_inner;
    const uint32_t x_span = g.x_span, y_span = g.y_span, pixel_step = g.pixel_step, row_step = g.row_step;
    for (int i = 0; i < count; ++i) {
        const bool inside = (x[i] >= -half) & (x[i] <= right) & (y[i] >= -half) & (y[i] <= bottom);
        Real xc = x[i] > 0 ? x[i] : 0, yc = y[i] > 0 ? y[i] : 0;
        xc = xc < x_last ? xc : x_last;
        yc = yc < y_last ? yc : y_last;
        uint32_t kind = inside ? 0 : OUTSIDE;
        int x0, y0;
        if constexpr (I == Interpolation::nearest) {
            x0 = static_cast<int>(xc + half), y0 = static_cast<int>(yc + half);
        } else {
            x0 = static_cast<int>(xc), y0 = static_cast<int>(yc);
            x0 = x0 < x0_max ? x0 : x0_max;
            y0 = y0 < y0_max ? y0 : y0_max;
            fx[i] = static_cast<F>(static_cast<int>((xc - static_cast<Real>(x0)) * scale + half));
            fy[i] = static_cast<F>(static_cast<int>((yc - static_cast<Real>(y0)) * scale + half));
        }
        if constexpr (I == Interpolation::cubic) {
            const bool inner = (static_cast<uint32_t>(x0 - x_inner) <= x_span) &
                               (static_cast<uint32_t>(y0 - y_inner) <= y_span);
            kind |= inner ? 0 : EDGE;
        }
        offsets[i] = (static_cast<uint32_t>(y0) * row_step + static_cast<uint32_t>(x0) * pixel_step) | kind;
    }
}

// Separate (x, y) pairs, and repeat the last one up to a multiple of 8.
template <class Real> void separate(const uint8_t* pairs, int count, Real* __restrict x, Real* __restrict y) {
    const Real* p = reinterpret_cast<const Real*>(pairs);
    for (int i = 0; i < count; ++i) x[i] = p[2 * i], y[i] = p[2 * i + 1];
    for (int i = count; i < round_up8(count); ++i) x[i] = x[count - 1], y[i] = y[count - 1];
}

template <class Isa, Interpolation I, class Real, class F>
void locate_pairs(const Coordinates& c, int row, int column, int count, const Geometry& g, uint32_t* offsets,
                  F* fx, F* fy) {
    alignas(64) Real x[STRIP], y[STRIP];
    separate(c.data + row * c.row_stride + static_cast<ptrdiff_t>(column) * 2 * sizeof(Real), count, x, y);
    Isa::template locate<I>(x, y, round_up8(count), g, offsets, fx, fy);
}

void polar_coordinates(const Polar& p, int row, int column, int count, float* __restrict x, float* __restrict y) {
    const float radius = p.radii[row];
    const float *cosines = p.cosines + column, *sines = p.sines + column;
    for (int i = 0; i < count; ++i) x[i] = p.x + radius * cosines[i], y[i] = p.y + radius * sines[i];
    for (int i = count; i < round_up8(count); ++i) x[i] = y[i] = -1;
}

// The sum of four neighbours' values with the weights of one phase; each is step entries apart in weights.
float weigh(const float* values, ptrdiff_t apart, const float* weights, int step) {
    return weights[0] * values[0] + weights[step] * values[apart] + weights[2 * step] * values[2 * apart] +
           weights[3 * step] * values[3 * apart];
}

// One row of one cell, from four columns of nodes that have been weighed along the rows.
void cell_row(const float* nodes, const float* __restrict weights, int step, float* __restrict out) {
    const float a = nodes[0], b = nodes[1], c = nodes[2], d = nodes[3];
    for (int i = 0; i < step; ++i)
        out[i] = a * weights[i] + b * weights[step + i] + c * weights[2 * step + i] + d * weights[3 * step + i];
}

// Make NaN what lies outside the ring that is seen.
void keep_ring(const Nodes& n, int count, float* __restrict x, const float* __restrict y) {
    const float x_centre = n.x_centre, y_centre = n.y_centre, least2 = n.least2, most2 = n.most2;
    for (int i = 0; i < count; ++i) {
        const float dx = x[i] - x_centre, dy = y[i] - y_centre, distance2 = dx * dx + dy * dy;
        x[i] = (distance2 >= least2) & (distance2 <= most2) ? x[i] : -1;
    }
}

// column and STRIP are multiples of the step, so a strip is made of whole cells (the last may be cut).
void node_coordinates(const Nodes& n, int row, int column, int count, float* x, float* y) {
    const int step = n.step, first = column / step, cells = (count + step - 1) / step;
    const int cell_row_index = row / step, phase = row % step;
    float x_nodes[STRIP / 8 + 3], y_nodes[STRIP / 8 + 3];
    for (int j = 0; j < cells + 3; ++j) {
        const ptrdiff_t at = static_cast<ptrdiff_t>(cell_row_index) * n.columns + first + j;
        x_nodes[j] = weigh(n.x + at, n.columns, n.weights + phase, step);
        y_nodes[j] = weigh(n.y + at, n.columns, n.weights + phase, step);
    }
    const int32_t* states = n.cells + static_cast<ptrdiff_t>(cell_row_index) * n.cell_columns + first;
    for (int j = 0; j < cells; ++j) {
        if (states[j] < 0) {
            cell_row(x_nodes + j, n.weights, step, x + j * step);
            cell_row(y_nodes + j, n.weights, step, y + j * step);
        } else {
            const float* patch = n.patches + (static_cast<ptrdiff_t>(states[j]) * step + phase) * step * 2;
            for (int i = 0; i < step; ++i) x[j * step + i] = patch[2 * i], y[j * step + i] = patch[2 * i + 1];
        }
    }
    if (n.x_centre == n.x_centre) keep_ring(n, cells * step, x, y);
}

template <class Isa, Interpolation I, class F>
Strip<F> find_strip(const Job& job, int row, int column, int count, uint8_t* out, Taps<F>& taps) {
    const Geometry& g = job.source.geometry;
    if (job.where == Where::packed) {
        const ptrdiff_t at = row * job.packed.row_step + column;
        const bool more = column + STRIP + round_up8(count) <= job.packed.row_step;
        return {job.packed.offsets + at, static_cast<const F*>(job.packed.fx) + at,
                static_cast<const F*>(job.packed.fy) + at, count, out,
                more ? job.packed.offsets + at + STRIP : nullptr};
    }
    if (job.where == Where::coordinates) {
        if (job.coordinates.is_double)
            locate_pairs<Isa, I, double>(job.coordinates, row, column, count, g, taps.offsets, taps.fx, taps.fy);
        else
            locate_pairs<Isa, I, float>(job.coordinates, row, column, count, g, taps.offsets, taps.fx, taps.fy);
    } else {
        alignas(64) float x[STRIP], y[STRIP];
        if (job.where == Where::polar)
            polar_coordinates(job.polar, row, column, count, x, y);
        else
            node_coordinates(job.nodes, row, column, count, x, y);
        Isa::template locate<I>(x, y, round_up8(count), g, taps.offsets, taps.fx, taps.fy);
    }
    return {taps.offsets, taps.fx, taps.fy, count, out, nullptr};
}

// -- the picture's values there --------------------------------------------------------------------

// Weights of the two inner taps (>= 0) and, without their sign, of the two outer ones; their sum is 1.
// Keys' kernel with a = -0.75, as in OpenCV.
template <class Real> constexpr void cubic_weights(Real t, Real (&w)[4]) {
    const Real a = Real(0.75), s = 1 - t;
    w[0] = a * t * s * s;
    w[3] = a * s * t * t;
    w[1] = ((2 - a) * t - (3 - a)) * t * t + 1;
    w[2] = 1 + w[0] + w[3] - w[1];
}

struct CubicTable {
    int16_t weights[256][4];     // signed, 16384 is 1, their sum is 16384
    uint32_t magnitudes[256][4]; // without sign, twice in 32 bits
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

// Vertical weights of uint8 pictures: fractions of 255 times 64.5, so that twice 255 * 128 * 16448 / 2^15
// leaves a value with 7 bits after the point, in 16 bits.
constexpr int LINEAR_ONE = 16448;
constexpr int linear_weight(int fy) { return (fy * 129) >> 1; }
constexpr int multiply_high(int a, int b) { return (a * b + 0x4000) >> 15; }  // as pmulhrsw and sqrdmulh do
constexpr uint8_t clamp8(int v) { return static_cast<uint8_t>(v < 0 ? 0 : v > 255 ? 255 : v); }

template <class T> T round_to(float v) {
    if constexpr (sizeof(T) == 4) return v;
    constexpr float most = sizeof(T) == 1 ? 255.0f : 65535.0f;
    v = v > 0 ? v : 0;
    v = v < most ? v : most;
    return static_cast<T>(v + 0.5f);
}
template <> float round_to<float>(float v) { return v; }

// One pixel of uint8, to the last bit what the vector kernels give.
template <int C> void linear_pixel(const Source& s, uint32_t offset, uint8_t fx, uint8_t fy, uint8_t* out) {
    const uint8_t *upper = s.data + offset, *lower = upper + s.geometry.row_step;
    const int w1 = linear_weight(fy), w0 = LINEAR_ONE - w1;
    for (int c = 0; c < C; ++c) {
        const int u = upper[c] * (255 - fx) + upper[C + c] * fx - 128 * 255;
        const int l = lower[c] * (255 - fx) + lower[C + c] * fx - 128 * 255;
        out[c] = clamp8(multiply_high(multiply_high(u, w0) + multiply_high(l, w1), 256) + 128);
    }
}

template <int C, class T> void linear_pixel(const Source& s, uint32_t offset, uint16_t fx, uint16_t fy, T* out) {
    const T *upper = reinterpret_cast<const T*>(s.data) + offset, *lower = upper + s.geometry.row_step;
    const float x = static_cast<float>(fx) / 65535, y = static_cast<float>(fy) / 65535;
    for (int c = 0; c < C; ++c) {
        const float u = static_cast<float>(upper[c]) * (1 - x) + static_cast<float>(upper[C + c]) * x;
        const float l = static_cast<float>(lower[c]) * (1 - x) + static_cast<float>(lower[C + c]) * x;
        out[c] = round_to<T>(u * (1 - y) + l * y);
    }
}

// Four rows' values at four taps, of one channel.
uint8_t cubic_sum(const uint8_t (&taps)[4][4], uint8_t fx, uint8_t fy) {
    int sum = 1 << 19;
    for (int k = 0; k < 4; ++k) {
        int column = 0;
        for (int j = 0; j < 4; ++j) {
            const int magnitude = static_cast<int>(CUBIC.magnitudes[fy][j] & 0xffff);
            const int product = (taps[j][k] * 256 * magnitude) >> 16;
            column += j == 1 || j == 2 ? product : -product;
        }
        sum += column * CUBIC.weights[fx][k];
    }
    return clamp8(sum >> 20);
}

template <class T> T cubic_sum(const T (&taps)[4][4], uint16_t fx, uint16_t fy) {
    float wx[4], wy[4], sum = 0;
    cubic_weights(static_cast<float>(fx) / 65535, wx);
    cubic_weights(static_cast<float>(fy) / 65535, wy);
    wx[0] = -wx[0], wx[3] = -wx[3], wy[0] = -wy[0], wy[3] = -wy[3];
    for (int j = 0; j < 4; ++j)
        sum += wy[j] * (wx[0] * static_cast<float>(taps[j][0]) + wx[1] * static_cast<float>(taps[j][1]) +
                        wx[2] * static_cast<float>(taps[j][2]) + wx[3] * static_cast<float>(taps[j][3]));
    return round_to<T>(sum);
}

// One pixel whose taps may lie beyond the picture: its edge is repeated.
template <int C, class T, class F> void cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, T* out) {
    const Geometry& g = s.geometry;
    const T* data = reinterpret_cast<const T*>(s.data);
    const int y0 = static_cast<int>(offset / g.row_step), x0 = static_cast<int>(offset % g.row_step / C);
    for (int c = 0; c < C; ++c) {
        T taps[4][4];
        for (int j = 0; j < 4; ++j) {
            const int y = smaller(larger(y0 - 1 + j, 0), g.y0_max + 1);
            const T* row = data + static_cast<ptrdiff_t>(y) * g.row_step + c;
            for (int k = 0; k < 4; ++k) taps[j][k] = row[smaller(larger(x0 - 1 + k, 0), g.x0_max + 1) * C];
        }
        out[c] = cubic_sum(taps, fx, fy);
    }
}

template <int C, class T, class F> void inner_cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, T* out) {
    const ptrdiff_t row_step = s.geometry.row_step;
    const T* first = reinterpret_cast<const T*>(s.data) + offset - row_step - C;
    for (int c = 0; c < C; ++c) {
        T taps[4][4];
        for (int j = 0; j < 4; ++j)
            for (int k = 0; k < 4; ++k) taps[j][k] = first[j * row_step + k * C + c];
        out[c] = cubic_sum(taps, fx, fy);
    }
}

template <Interpolation I, int C, class T, class F>
void sample_pixel(const Job& job, uint32_t offset, F fx, F fy, T* out) {
    if (offset == OUTSIDE)
        std::memcpy(out, job.border, C * sizeof(T));
    else if constexpr (I == Interpolation::nearest)
        std::memcpy(out, reinterpret_cast<const T*>(job.source.data) + offset, C * sizeof(T));
    else if constexpr (I == Interpolation::linear)
        linear_pixel<C>(job.source, offset, fx, fy, out);
    else if (offset & EDGE)
        cubic_pixel<C>(job.source, offset & ~EDGE, fx, fy, out);
    else
        inner_cubic_pixel<C>(job.source, offset, fx, fy, out);
}

struct Plain {
    template <Interpolation I, class Real, class F>
    static void locate(const Real* x, const Real* y, int count, const Geometry& g, uint32_t* offsets, F* fx, F* fy) {
        omnimirror::locate<I>(x, y, count, g, offsets, fx, fy);
    }

    template <Interpolation I, int C, class T> static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        T* out = reinterpret_cast<T*>(s.out);
        for (int i = 0; i < s.count; ++i) sample_pixel<I, C>(job, s.offsets[i], s.fx[i], s.fy[i], out + i * C);
    }
};

// -- tiles -----------------------------------------------------------------------------------------

template <class Isa, Interpolation I, int C, class T> void sample_tile(const Job& job, const Tile& tile) {
    Taps<Fraction<T>> taps;
    if constexpr (I == Interpolation::nearest) std::memset(&taps, 0, sizeof taps);  // it has no fractions
    for (int row = tile.top; row < tile.bottom; ++row) {
        uint8_t* out = job.target.data + row * job.target.stride;
        for (int column = tile.left; column < tile.right; column += STRIP) {
            const int count = smaller(STRIP, tile.right - column);
            uint8_t* at = out + static_cast<ptrdiff_t>(column) * C * static_cast<ptrdiff_t>(sizeof(T));
            Isa::template sample_strip<I, C, T>(job, find_strip<Isa, I>(job, row, column, count, at, taps));
        }
    }
}

template <class Isa, Interpolation I, int C> void sample_of_depth(const Job& job, const Tile& tile) {
    switch (job.source.depth) {
        case Depth::u8: return sample_tile<Isa, I, C, uint8_t>(job, tile);
        case Depth::u16: return sample_tile<Isa, I, C, uint16_t>(job, tile);
        case Depth::f32: return sample_tile<Isa, I, C, float>(job, tile);
    }
}

template <class Isa, Interpolation I> void sample_of_channels(const Job& job, const Tile& tile) {
    switch (job.source.channels) {
        case 1: return sample_of_depth<Isa, I, 1>(job, tile);
        case 3: return sample_of_depth<Isa, I, 3>(job, tile);
        case 4: return sample_of_depth<Isa, I, 4>(job, tile);
    }
}

template <class Isa> void sample(const Job& job, const Tile& tile) {
    switch (job.interpolation) {
        case Interpolation::nearest: return sample_of_channels<Isa, Interpolation::nearest>(job, tile);
        case Interpolation::linear: return sample_of_channels<Isa, Interpolation::linear>(job, tile);
        case Interpolation::cubic: return sample_of_channels<Isa, Interpolation::cubic>(job, tile);
    }
}

template <class Isa, Interpolation I, class F> void pack_rows(const Packing& p, int top, int bottom) {
    for (int row = top; row < bottom; ++row) {
        for (int column = 0; column < p.width; column += STRIP) {
            const int count = smaller(STRIP, p.width - column);
            const ptrdiff_t at = row * p.row_step + column;
            F *fx = static_cast<F*>(p.fx) + at, *fy = static_cast<F*>(p.fy) + at;
            if (p.coordinates.is_double)
                locate_pairs<Isa, I, double>(p.coordinates, row, column, count, p.geometry, p.offsets + at, fx, fy);
            else
                locate_pairs<Isa, I, float>(p.coordinates, row, column, count, p.geometry, p.offsets + at, fx, fy);
        }
    }
}

template <class Isa, class F> void pack_with(const Packing& p, int top, int bottom) {
    switch (p.interpolation) {
        case Interpolation::nearest: return pack_rows<Isa, Interpolation::nearest, F>(p, top, bottom);
        case Interpolation::linear: return pack_rows<Isa, Interpolation::linear, F>(p, top, bottom);
        case Interpolation::cubic: return pack_rows<Isa, Interpolation::cubic, F>(p, top, bottom);
    }
}

template <class Isa> void pack(const Packing& p, int top, int bottom) {
    p.is_deep ? pack_with<Isa, uint16_t>(p, top, bottom) : pack_with<Isa, uint8_t>(p, top, bottom);
}

}  // namespace
}  // namespace omnimirror
