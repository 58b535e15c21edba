// Source coordinates of output pixels, in plain C++: see common.hpp.
#pragma once

#include "common.hpp"

namespace omnimirror {
namespace {

// Up to STRIP adjacent output pixels. Entries up to the next multiple of 8 are readable and valid.
template <class F>
struct Strip {
    const Block<F>* blocks;
    int count;
    uint8_t* out;
    const Block<F>* prefetched;  // as many blocks, to be prefetched, or nullptr
};

// Convert coordinates of 8 pixels to offsets and fractions. The loop has no branches, so that compilers vectorise it;
// comparisons are false for NaN.
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

// Above this value the spacing of float is 1: x + 1/2 and the index of the last pixel are not exact.
constexpr int LONG_SIDE = 1 << 23;

bool is_long(const Geometry& g) { return g.width > LONG_SIDE || g.height > LONG_SIDE; }

// x and y hold count values; count is a multiple of 8 and at most STRIP + 8.
template <Interpolation I, class Real, class F>
void locate(const Real* x, const Real* y, int count, const Geometry& geometry, Block<F>* blocks) {
    const Geometry g = geometry;
    if (sizeof(Real) < sizeof(double) && is_long(g)) {
        alignas(64) double longer_x[STRIP + 8], longer_y[STRIP + 8];
        for (int i = 0; i < count; ++i) longer_x[i] = x[i], longer_y[i] = y[i];
        for (int i = 0; i < count; i += 8) locate_8<I>(longer_x + i, longer_y + i, g, blocks[i / 8]);
        return;
    }
    for (int i = 0; i < count; i += 8) locate_8<I>(x + i, y + i, g, blocks[i / 8]);
}

// Split (x, y) pairs into two arrays, and repeat the last value up to a multiple of 8.
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

// Return whether a disc lies so far inside the image that its coordinates need no checks and its taps no edge
// replication.
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

constexpr float FINE = 65536;  // subdivisions of a pixel in some kernels

// Interpolate columns of nodes vertically, for one row of a strip; 8 at a time, so up to 7 extra values are written.
void interpolate_nodes(const float* __restrict nodes, ptrdiff_t columns, const float* weights, int step, int count,
                       float* __restrict out, float* __restrict fine) {
    const float wa = weights[0], wb = weights[step], wc = weights[2 * step], wd = weights[3 * step];
    const float *a = nodes, *b = a + columns, *c = b + columns, *d = c + columns;
    for (int j = 0; j < count; j += 8)
        for (int k = j; k < j + 8; ++k) {
            out[k] = wa * a[k] + wb * b[k] + wc * c[k] + wd * d[k];
            fine[k] = out[k] * FINE;
        }
}

// One row of one cell, from four vertically interpolated columns of nodes; 8 at a time, so that compilers use one
// vector.
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

// The cells of one row of a strip. column and STRIP are multiples of the step, so a strip consists of whole cells;
// coordinates of the last cell beyond the image are computed too, but not used.
struct CellRow {
    int count, step, phase;
    bool is_inner;
    const int32_t* states;
    alignas(32) float x[24], y[24];  // vertically interpolated nodes; at most 19 are needed
    alignas(32) float fine_x[24], fine_y[24];
};

void interpolate_cell_row(const Lattice& n, int row, int column, int pixels, CellRow& r) {
    r.step = 1 << n.log2_step, r.phase = row & (r.step - 1), r.count = (pixels + r.step - 1) >> n.log2_step;
    const ptrdiff_t first = column >> n.log2_step, cell = row >> n.log2_step, at = cell * n.columns + first;
    interpolate_nodes(n.x + at, n.columns, n.row_weights + r.phase, r.step, r.count + 3, r.x, r.fine_x);
    interpolate_nodes(n.y + at, n.columns, n.row_weights + r.phase, r.step, r.count + 3, r.y, r.fine_y);
    r.states = n.cells + cell * n.cell_columns + first;
    r.is_inner = true;
    for (int j = 0; j < r.count; ++j) r.is_inner &= r.states[j] == INNER;
}

// x and y have room for half a vector beyond a strip: cells of 4 pixels are computed 8 at a time, and the next cell
// overwrites the excess values.
template <class Isa>
void lattice_coordinates(const Lattice& n, const CellRow& r, float* x, float* y) {
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
void locate_lattice(const Lattice& n, const Geometry& g, const CellRow& r, int count, Block<F>* blocks) {
    if (r.is_inner) return Isa::template locate_inner_cells<I>(n, r, g, blocks);
    alignas(64) float x[STRIP + 8], y[STRIP + 8];
    lattice_coordinates<Isa>(n, r, x, y);
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

// A strip of a packed map. Consecutive full strips are contiguous, with at most two per row.
template <class F>
Strip<F> packed_strip(const Job& job, int row, int column, int count, uint8_t* out) {
    const Packed& p = job.packed;
    const Block<F>* first = static_cast<const Block<F>*>(p.blocks) + panel_block_index(p.rows, p.columns, row, column);
    const bool more = row + PREFETCH_STRIPS < p.rows && count == STRIP && job.source.elements > MIN_PREFETCH_ELEMENTS;
    return {first, count, out, more ? first + PREFETCH_STRIPS * STRIP / 8 : nullptr};
}

template <class Isa, Interpolation I, class F>
void locate_strip(const Job& job, int row, int column, int count, Block<F>* blocks) {
    const Geometry& g = job.source.geometry;
    if (job.map_type == MapType::polar)
        locate_polar<Isa, I>(job.polar, g, row, column, count, blocks);
    else if (job.coordinates.is_double)
        locate_pairs<Isa, I, double>(job.coordinates, row, column, count, g, blocks);
    else
        locate_pairs<Isa, I, float>(job.coordinates, row, column, count, g, blocks);
}

}  // namespace
}  // namespace omnimirror
