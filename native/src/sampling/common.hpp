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

template <class T>
T smaller(T a, T b) {
    return b < a ? b : a;
}
template <class T>
T larger(T a, T b) {
    return a < b ? b : a;
}

// Fractions of deep pictures are finer: 1/65535 of a pixel instead of 1/255. A fraction of 1 occurs, at the
// last pixel, which has no right or lower neighbour.
template <class T>
struct FractionOf {
    using type = uint16_t;
};
template <>
struct FractionOf<uint8_t> {
    using type = uint8_t;
};
template <class T>
using Fraction = typename FractionOf<T>::type;
template <class F>
constexpr int one = sizeof(F) == 1 ? 255 : 65535;

// Pictures with more values are fetched ahead; smaller ones are in the cache anyway.
constexpr int64_t FETCHED_FROM = 4'000'000;
constexpr int AHEAD = 16;  // so many strips, some 8 rows of a panel, are located before they are sampled

constexpr int round_up8(int n) { return (n + 7) & ~7; }

// -- where output pixels look ----------------------------------------------------------------------

// Up to STRIP adjoining output pixels. Entries up to the next multiple of 8 can be read, and are harmless.
template <class F>
struct Strip {
    const Block<F>* blocks;
    int count;
    uint8_t* out;
    const Block<F>* ahead;  // as many that are wanted soon, or nullptr
};

// Coordinates of 8 pixels to offsets and fractions. Written so that compilers vectorise it: no branches, and
// comparisons that are false for NaN.
template <Interpolation I, class Real, class F>
void locate_8(const Real* __restrict x, const Real* __restrict y, const Geometry& g, Block<F>& __restrict block) {
    const Real right = static_cast<Real>(g.width - 0.5), bottom = static_cast<Real>(g.height - 0.5);
    const Real x_last = static_cast<Real>(g.width - 1), y_last = static_cast<Real>(g.height - 1);
    const Real scale = one<F>, half = static_cast<Real>(0.5);
    for (int i = 0; i < 8; ++i) {
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
            x0 = x0 < g.x0_max ? x0 : g.x0_max;
            y0 = y0 < g.y0_max ? y0 : g.y0_max;
            block.fx[i] = static_cast<F>(static_cast<int>((xc - static_cast<Real>(x0)) * scale + half));
            block.fy[i] = static_cast<F>(static_cast<int>((yc - static_cast<Real>(y0)) * scale + half));
        }
        if constexpr (I == Interpolation::cubic) {
            const bool inner = (static_cast<uint32_t>(x0 - g.x_inner) <= g.x_span) &
                               (static_cast<uint32_t>(y0 - g.y_inner) <= g.y_span);
            kind |= inner ? 0 : EDGE;
        }
        block.offsets[i] = (static_cast<uint32_t>(y0) * g.row_step + static_cast<uint32_t>(x0) * g.pixel_step) | kind;
    }
}

// x and y hold count, a multiple of 8.
template <Interpolation I, class Real, class F>
void locate(const Real* x, const Real* y, int count, const Geometry& geometry, Block<F>* blocks) {
    const Geometry g = geometry;
    for (int i = 0; i < count; i += 8) locate_8<I>(x + i, y + i, g, blocks[i / 8]);
}

// Separate (x, y) pairs, and repeat the last one up to a multiple of 8.
template <class Real>
void separate(const uint8_t* pairs, int count, Real* __restrict x, Real* __restrict y) {
    const Real* p = reinterpret_cast<const Real*>(pairs);
    for (int i = 0; i < count; ++i) x[i] = p[2 * i], y[i] = p[2 * i + 1];
    for (int i = count; i < round_up8(count); ++i) x[i] = x[count - 1], y[i] = y[count - 1];
}

template <class Isa, Interpolation I, class Real, class F>
void locate_pairs(const Coordinates& c, int row, int column, int count, const Geometry& g, Block<F>* blocks) {
    alignas(64) Real x[STRIP], y[STRIP];
    separate(c.data + row * c.row_stride + static_cast<ptrdiff_t>(column) * 2 * sizeof(Real), count, x, y);
    Isa::template locate<I>(x, y, round_up8(count), g, blocks);
}

// Whether a disc lies so far within the picture that no coordinate in it needs a check, and no tap an edge.
bool is_inner(const Geometry& g, float x, float y, float radius) {
    return x - radius >= 2 && x + radius <= static_cast<float>(g.width - 3) && y - radius >= 2 &&
           y + radius <= static_cast<float>(g.height - 3);
}

void polar_coordinates(const Polar& p, int row, int column, int count, float* __restrict x, float* __restrict y) {
    const float radius = p.radii[row];
    const float *cosines = p.cosines + column, *sines = p.sines + column;
    for (int i = 0; i < count; i += 8)
        for (int k = i; k < i + 8; ++k) x[k] = p.x + radius * cosines[k], y[k] = p.y + radius * sines[k];
}

constexpr float FINE = 65536;  // steps into which some kernels divide a pixel

// Columns of nodes weighed along the rows, for one row of a strip: 8 at a time, and so up to 7 too many.
void weigh_nodes(const float* __restrict nodes, ptrdiff_t columns, const float* weights, int step, int count,
                 float* __restrict out, float* __restrict fine) {
    const float wa = weights[0], wb = weights[step], wc = weights[2 * step], wd = weights[3 * step];
    const float *a = nodes, *b = a + columns, *c = b + columns, *d = c + columns;
    for (int j = 0; j < count; j += 8)
        for (int k = j; k < j + 8; ++k) {
            out[k] = wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k];
            fine[k] = out[k] * FINE;
        }
}

// One row of one cell, from four columns of nodes that have been weighed along the rows. 8 at a time, so that
// compilers make one vector of them.
void cell_row(const float* x_nodes, const float* y_nodes, const float* __restrict weights, int step,
              float* __restrict x, float* __restrict y) {
    const float xa = x_nodes[0], xb = x_nodes[1], xc = x_nodes[2], xd = x_nodes[3];
    const float ya = y_nodes[0], yb = y_nodes[1], yc = y_nodes[2], yd = y_nodes[3];
    const float *wa = weights, *wb = wa + step, *wc = wb + step, *wd = wc + step;
    for (int i = 0; i < step; i += 8)
        for (int k = i; k < i + 8; ++k) {
            x[k] = xa * wa[k] + xb * wb[k] + xc * wc[k] + xd * wd[k];
            y[k] = ya * wa[k] + yb * wb[k] + yc * wc[k] + yd * wd[k];
        }
}

// The cells of one row of a strip. column and STRIP are multiples of the step, so a strip is made of whole cells; what
// the last one has beyond the picture is found too, and does no harm.
struct RowOfCells {
    int count, step, phase;
    bool is_inner;
    const int32_t* states;
    alignas(32) float x[24], y[24];  // nodes weighed along the rows; up to 19 are needed
    alignas(32) float fine_x[24], fine_y[24];
};

void weigh_row(const Nodes& n, int row, int column, int pixels, RowOfCells& r) {
    r.step = 1 << n.log2_step, r.phase = row & (r.step - 1), r.count = (pixels + r.step - 1) >> n.log2_step;
    const ptrdiff_t first = column >> n.log2_step, cell = row >> n.log2_step, at = cell * n.columns + first;
    weigh_nodes(n.x + at, n.columns, n.row_weights + r.phase, r.step, r.count + 3, r.x, r.fine_x);
    weigh_nodes(n.y + at, n.columns, n.row_weights + r.phase, r.step, r.count + 3, r.y, r.fine_y);
    r.states = n.cells + cell * n.cell_columns + first;
    r.is_inner = true;
    for (int j = 0; j < r.count; ++j) r.is_inner &= r.states[j] == INNER;
}

// x and y have room for half a vector more than a strip: cells of 4 pixels are made 8 at a time, and the next cell
// overwrites what is too much.
template <class Isa>
void node_coordinates(const Nodes& n, const RowOfCells& r, float* x, float* y) {
    for (int j = 0; j < r.count; ++j) {
        float *x_cell = x + j * r.step, *y_cell = y + j * r.step;
        if (r.states[j] < 0) {
            Isa::cell_row(r.x + j, r.y + j, n.weights, r.step, x_cell, y_cell);
        } else {
            const float* patch = n.patches + (static_cast<ptrdiff_t>(r.states[j]) * r.step + r.phase) * r.step * 2;
            for (int i = 0; i < r.step; ++i) x_cell[i] = patch[2 * i], y_cell[i] = patch[2 * i + 1];
        }
    }
    const int pixels = r.count * r.step;
    for (int i = pixels; i < round_up8(pixels); ++i) x[i] = x[0], y[i] = y[0];
}

template <class Isa, Interpolation I, class F>
void locate_nodes(const Nodes& n, const Geometry& g, const RowOfCells& r, int count, Block<F>* blocks) {
    if (r.is_inner) return Isa::template locate_inner_cells<I>(n, r, g, blocks);
    alignas(64) float x[STRIP + 8], y[STRIP + 8];
    node_coordinates<Isa>(n, r, x, y);
    Isa::template locate<I>(x, y, round_up8(count), g, blocks);
}

template <class Isa, Interpolation I, class F>
void locate_polar(const Polar& p, const Geometry& g, int row, int column, int count, Block<F>* blocks) {
    if (is_inner(g, p.x, p.y, std::fabs(p.radii[row]) * p.reach))
        return Isa::template locate_inner_ring<I>(p, row, column, round_up8(count), g, blocks);
    alignas(64) float x[STRIP], y[STRIP];
    polar_coordinates(p, row, column, round_up8(count), x, y);
    Isa::template locate<I>(x, y, round_up8(count), g, blocks);
}

// A strip of a packed map. Full strips that follow each other adjoin, and there are at most two in a row.
template <class F>
Strip<F> packed_strip(const Job& job, int row, int column, int count, uint8_t* out) {
    const Packed& p = job.packed;
    const Block<F>* first = static_cast<const Block<F>*>(p.blocks) + place_in_panels(p.rows, p.columns, row, column);
    const bool more = row + AHEAD < p.rows && count == STRIP && job.source.elements > FETCHED_FROM;
    return {first, count, out, more ? first + AHEAD * STRIP / 8 : nullptr};
}

template <class Isa, Interpolation I, class F>
void locate_strip(const Job& job, int row, int column, int count, Block<F>* blocks) {
    const Geometry& g = job.source.geometry;
    if (job.where == Where::polar)
        locate_polar<Isa, I>(job.polar, g, row, column, count, blocks);
    else if (job.coordinates.is_double)
        locate_pairs<Isa, I, double>(job.coordinates, row, column, count, g, blocks);
    else
        locate_pairs<Isa, I, float>(job.coordinates, row, column, count, g, blocks);
}

// -- the picture's values there --------------------------------------------------------------------

// Weights of the two inner taps (>= 0) and, without their sign, of the two outer ones; their sum is 1.
// Keys' kernel with a = -0.75, as in OpenCV.
template <class Real>
constexpr void cubic_weights(Real t, Real (&w)[4]) {
    const Real a = Real(0.75), s = 1 - t;
    w[0] = a * t * s * s;
    w[3] = a * s * t * t;
    w[1] = ((2 - a) * t - (3 - a)) * t * t + 1;
    w[2] = 1 + w[0] + w[3] - w[1];
}

struct CubicTable {
    int16_t weights[256][4];      // signed, 16384 is 1, their sum is 16384
    uint32_t magnitudes[256][4];  // without sign, twice in 32 bits
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

template <class T>
T round_to(float v) {
    if constexpr (sizeof(T) == 4) return v;
    constexpr float most = sizeof(T) == 1 ? 255.0f : 65535.0f;
    v = v > 0 ? v : 0;
    v = v < most ? v : most;
    return static_cast<T>(v + 0.5f);
}
template <>
float round_to<float>(float v) {
    return v;
}

// One pixel of uint8, to the last bit what the vector kernels give.
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

// Four rows' values at four taps, of one channel, weighed: 20 bits of it after the point.
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

// One pixel whose taps may lie beyond the picture: its edge is repeated. Every channel's sum goes to take(c, sum).
template <int C, class T, class F, class Take>
void cubic_pixel(const Source& s, uint32_t offset, F fx, F fy, Take take) {
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

struct Plain {
    template <Interpolation I, class Real, class F>
    static void locate(const Real* x, const Real* y, int count, const Geometry& g, Block<F>* blocks) {
        omnimirror::locate<I>(x, y, count, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_cells(const Nodes& n, const RowOfCells& r, const Geometry& g, Block<F>* blocks) {
        alignas(64) float x[STRIP + 8], y[STRIP + 8];
        node_coordinates<Plain>(n, r, x, y);
        omnimirror::locate<I>(x, y, round_up8(r.count * r.step), g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_ring(const Polar& p, int row, int column, int count, const Geometry& g, Block<F>* blocks) {
        alignas(64) float x[STRIP], y[STRIP];
        polar_coordinates(p, row, column, count, x, y);
        omnimirror::locate<I>(x, y, count, g, blocks);
    }

    static void cell_row(const float* x_nodes, const float* y_nodes, const float* weights, int step, float* x,
                         float* y) {
        omnimirror::cell_row(x_nodes, y_nodes, weights, step, x, y);
    }

    template <Interpolation I, int C, class T>
    static void sample_strip(const Job& job, const Strip<Fraction<T>>& s) {
        T* out = reinterpret_cast<T*>(s.out);
        for (int i = 0; i < s.count; ++i) {
            const Block<Fraction<T>>& b = s.blocks[i / 8];
            sample_pixel<I, C>(job, b.offsets[i % 8], b.fx[i % 8], b.fy[i % 8], out + i * C);
        }
    }
};

// -- tiles -----------------------------------------------------------------------------------------

// Panels are too narrow for the processor to see where the next row will be written.
void fetch_to_write(uint8_t* out, int bytes) {
#if defined(__GNUC__)
    for (int i = 0; i < bytes; i += 64) __builtin_prefetch(out + i, 1);
#else
    (void)out, (void)bytes;
#endif
}

// Goes from strip to strip of a tile, row after row.
struct Cursor {
    const Tile& tile;
    int row, column, index = 0;

    explicit Cursor(const Tile& t) : tile(t), row(t.top), column(t.left) {}
    bool is_done() const { return row >= tile.bottom; }
    int width() const { return smaller(STRIP, tile.right - column); }

    void go_on() {
        ++index, column += STRIP;
        if (column >= tile.right) column = tile.left, ++row;
    }
};

// Locates the strips of a tile one after the other.
template <class Isa, Interpolation I, class F>
struct Locator {
    static constexpr int SLOTS = AHEAD + 1;

    const Job& job;
    Cursor at, weighed;  // nodes are weighed one strip earlier still: what follows would wait for them
    RowOfCells cells[2];
    alignas(64) Block<F> blocks[SLOTS][STRIP / 8];

    Locator(const Job& j, const Tile& tile) : job(j), at(tile), weighed(tile) {
        if constexpr (I == Interpolation::nearest) std::memset(blocks, 0, sizeof blocks);  // it has no fractions
        weigh();
    }

    Block<F>* of(int index) { return blocks[index % SLOTS]; }

    void weigh() {
        if (job.where != Where::nodes || weighed.is_done()) return;
        weigh_row(job.nodes, weighed.row, weighed.column, weighed.width(), cells[weighed.index % 2]);
        weighed.go_on();
    }

    void locate() {
        const int width = at.width();
        weigh();
        if (job.where == Where::nodes)
            locate_nodes<Isa, I>(job.nodes, job.source.geometry, cells[at.index % 2], width, of(at.index));
        else
            locate_strip<Isa, I>(job, at.row, at.column, width, of(at.index));
        at.go_on();
    }
};

template <int C, class T>
uint8_t* place_in_target(const Job& job, int row, int column) {
    const ptrdiff_t pixel = C * static_cast<ptrdiff_t>(sizeof(T));
    return job.target.data + row * job.target.stride + column * pixel;
}

template <class Isa, Interpolation I, int C, class T>
void sample_packed_tile(const Job& job, const Tile& tile) {
    for (Cursor at(tile); !at.is_done(); at.go_on()) {
        uint8_t* out = place_in_target<C, T>(job, at.row, at.column);
        const int width = at.width();
        if (at.row + 1 < tile.bottom) fetch_to_write(out + job.target.stride, width * C * static_cast<int>(sizeof(T)));
        Isa::template sample_strip<I, C, T>(job, packed_strip<Fraction<T>>(job, at.row, at.column, width, out));
    }
}

template <class Isa, Interpolation I, int C, class T>
void sample_tile(const Job& job, const Tile& tile) {
    using F = Fraction<T>;
    if (job.where == Where::packed) return sample_packed_tile<Isa, I, C, T>(job, tile);
    const bool is_fetched = job.source.elements > FETCHED_FROM;
    Locator<Isa, I, F> locator(job, tile);
    for (int i = 0; i < AHEAD && !locator.at.is_done(); ++i) locator.locate();
    for (Cursor at(tile); !at.is_done(); at.go_on()) {
        uint8_t* out = place_in_target<C, T>(job, at.row, at.column);
        const int width = at.width();
        if (at.row + 1 < tile.bottom) fetch_to_write(out + job.target.stride, width * C * static_cast<int>(sizeof(T)));
        const Block<F>* ahead = nullptr;
        if (!locator.at.is_done()) {
            const int soon = locator.at.index;
            const bool is_as_wide = locator.at.width() >= width;
            locator.locate();
            if (is_fetched && is_as_wide) ahead = locator.of(soon);
        }
        Isa::template sample_strip<I, C, T>(job, {locator.of(at.index), width, out, ahead});
    }
}

template <class Isa, Interpolation I, int C>
void sample_of_depth(const Job& job, const Tile& tile) {
    switch (job.source.depth) {
        case Depth::u8: return sample_tile<Isa, I, C, uint8_t>(job, tile);
        case Depth::u16: return sample_tile<Isa, I, C, uint16_t>(job, tile);
        case Depth::f32: return sample_tile<Isa, I, C, float>(job, tile);
    }
}

template <class Isa, Interpolation I>
void sample_of_channels(const Job& job, const Tile& tile) {
    switch (job.source.channels) {
        case 1: return sample_of_depth<Isa, I, 1>(job, tile);
        case 2: return sample_of_depth<Isa, I, 2>(job, tile);
        case 3: return sample_of_depth<Isa, I, 3>(job, tile);
        case 4: return sample_of_depth<Isa, I, 4>(job, tile);
    }
}

template <class Isa>
void sample(const Job& job, const Tile& tile) {
    switch (job.interpolation) {
        case Interpolation::nearest: return sample_of_channels<Isa, Interpolation::nearest>(job, tile);
        case Interpolation::linear: return sample_of_channels<Isa, Interpolation::linear>(job, tile);
        case Interpolation::cubic: return sample_of_channels<Isa, Interpolation::cubic>(job, tile);
    }
}

template <class Isa, Interpolation I, class F>
void pack_rows(const Packing& p, int top, int bottom) {
    for (int row = top; row < bottom; ++row) {
        for (int column = 0; column < p.width; column += STRIP) {
            const int count = smaller(STRIP, p.width - column);
            Block<F>* blocks = static_cast<Block<F>*>(p.blocks) + place_in_panels(p.rows, p.width, row, column);
            if (p.coordinates.is_double)
                locate_pairs<Isa, I, double>(p.coordinates, row, column, count, p.geometry, blocks);
            else
                locate_pairs<Isa, I, float>(p.coordinates, row, column, count, p.geometry, blocks);
        }
    }
}

template <class Isa, class F>
void pack_with(const Packing& p, int top, int bottom) {
    switch (p.interpolation) {
        case Interpolation::nearest: return pack_rows<Isa, Interpolation::nearest, F>(p, top, bottom);
        case Interpolation::linear: return pack_rows<Isa, Interpolation::linear, F>(p, top, bottom);
        case Interpolation::cubic: return pack_rows<Isa, Interpolation::cubic, F>(p, top, bottom);
    }
}

template <class Isa>
void pack(const Packing& p, int top, int bottom) {
    p.is_deep ? pack_with<Isa, uint16_t>(p, top, bottom) : pack_with<Isa, uint8_t>(p, top, bottom);
}

}  // namespace
}  // namespace omnimirror
