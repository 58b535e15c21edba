// Averages over footprints. The footprint of an output pixel extends half way to each of its neighbours; its value is
// the mean of cubic samples spaced evenly over the footprint. Output is processed in blocks, so that all data except
// the image stays in the L1 cache. src/omnimirror/dewarp/sampling.py contains the equivalent Python implementation.
//
// Tap (i, j) of n x m lies at p + |s| a(s) + |t| b(t), s = (i + 1/2)/n - 1/2, t = (j + 1/2)/m - 1/2, where a is the
// vector to the left neighbour for s < 0 and to the right neighbour otherwise, and b likewise the vector to the
// neighbour above or below. Each vector is scaled by 1 - (sharp/|a|)^8, or by 0 where |a| <= sharp.
#pragma once

#include <initializer_list>

#include "sums.hpp"

namespace omnimirror {
namespace {

constexpr int BLOCK_ROWS = 8;
constexpr int HALO = 8;  // one column is needed on each side; 8 keep the rows aligned
constexpr float UNDEFINED = __builtin_nanf("");

template <class Real>
void separate_as_floats(const uint8_t* pairs, int count, float* x, float* y) {
    const Real* p = reinterpret_cast<const Real*>(pairs);
    for (int i = 0; i < count; ++i) x[i] = static_cast<float>(p[2 * i]), y[i] = static_cast<float>(p[2 * i + 1]);
}

// Source coordinates of the output pixels of one row in columns [left, right).
template <class Isa>
void row_coordinates(const Job& job, int row, int left, int right, float* x, float* y) {
    if (job.map_type == MapType::polar) {
        const Polar& p = job.polar;
        for (int i = left; i < right; ++i)
            x[i - left] = p.x + p.radii[row] * p.cosines[i], y[i - left] = p.y + p.radii[row] * p.sines[i];
    } else if (job.map_type == MapType::lattice) {
        const Lattice& n = job.lattice;
        alignas(64) float xs[STRIP + 8], ys[STRIP + 8];
        CellRow cells;
        for (int column = left >> n.log2_step << n.log2_step; column < right; column += STRIP) {
            interpolate_cell_row(n, row, column, min_of(STRIP, right - column), cells);
            lattice_coordinates<Isa>(n, cells, xs, ys);
            const int first = max_of(left - column, 0), last = min_of(STRIP, right - column);
            for (int i = first; i < last; ++i) x[column + i - left] = xs[i], y[column + i - left] = ys[i];
        }
    } else {
        const Coordinates& c = job.coordinates;
        const uint8_t* pairs = c.data + row * c.row_stride + static_cast<ptrdiff_t>(left) * (c.is_double ? 16 : 8);
        c.is_double ? separate_as_floats<double>(pairs, right - left, x, y)
                    : separate_as_floats<float>(pairs, right - left, x, y);
    }
}

void mask_outside_image(const Geometry& g, int count, float* __restrict x, float* __restrict y) {
    const float right = static_cast<float>(g.width - 0.5), bottom = static_cast<float>(g.height - 0.5);
    for (int i = 0; i < count; ++i) {
        const bool inside = (x[i] >= -0.5f) & (x[i] <= right) & (y[i] >= -0.5f) & (y[i] <= bottom);
        x[i] = inside ? x[i] : UNDEFINED, y[i] = inside ? y[i] : UNDEFINED;
    }
}

// Source coordinates of a block of output pixels and of the adjacent pixels on all sides; NaN outside the image. They
// are extrapolated linearly above and below the output, and quadratically beyond its left and right edges, because at
// the seam of a full panorama the adjacent columns lie on a circle.
struct Neighbourhood {
    static constexpr int STRIDE = PANEL + 2 * HALO;
    static constexpr int SIZE = (BLOCK_ROWS + 2) * STRIDE;
    alignas(64) float xs[SIZE], ys[SIZE];

    static int place(int row, int column) { return (row + 1) * STRIDE + HALO + column; }

    template <class Isa>
    void find(const Job& job, const Tile& tile) {
        const int width = tile.right - tile.left, height = tile.bottom - tile.top;
        const bool begins = tile.left == 0, ends = tile.right == job.target.width;
        const int first = max_of(tile.left - (ends ? 2 : 1), 0);
        const int last = min_of(tile.right + (begins ? 2 : 1), job.target.width);
        const int top = max_of(tile.top - 1, 0), bottom = min_of(tile.bottom + 1, job.target.height);
        for (int row = top; row < bottom; ++row) {
            const int begin = place(row - tile.top, first - tile.left), end = place(row - tile.top, width);
            row_coordinates<Isa>(job, row, first, last, xs + begin, ys + begin);
            mask_outside_image(job.source.geometry, last - first, xs + begin, ys + begin);
            for (float* values : {xs, ys}) {
                if (begins) values[begin - 1] = extrapolated(values + begin, 1, last - first);
                if (ends) values[end] = extrapolated(values + end - 1, -1, last - first);
            }
            const int padding = place(row - tile.top, round_up8(width));
            for (int i = end + 1; i <= padding; ++i) xs[i] = xs[end], ys[i] = ys[end];
        }
        const int step = bottom - top > 1 ? STRIDE : 0, count = round_up8(width) + 2;
        if (top == tile.top) advance(place(-1, -1), place(0, -1), step, count);
        if (bottom == tile.bottom) advance(place(height, -1), place(height - 1, -1), -step, count);
    }

  private:
    // Extrapolate one value before the known ones, with a parabola through three of them if available, otherwise
    // linearly.
    static float extrapolated(const float* values, int step, int known) {
        const float one = values[0], two = known > 1 ? values[step] : one;
        const float bent = known > 2 ? 3 * (one - two) + values[2 * step] : UNDEFINED;
        return bent == bent ? bent : 2 * one - two;
    }

    // Extrapolate linearly from a row and the row one step behind it.
    void advance(int to, int from, int step_back, int count) {
        for (int i = 0; i < count; ++i) {
            xs[to + i] = 2 * xs[from + i] - xs[from + step_back + i];
            ys[to + i] = 2 * ys[from + i] - ys[from + step_back + i];
        }
    }
};

// Vectors from each pixel of a strip to its two neighbours along one axis: the sides of its footprint.
struct Sides {
    alignas(64) float x[2][STRIP], y[2][STRIP];
};

// A neighbour many times farther away than the opposite one belongs to another view of a mosaic.
constexpr float JUMP_RATIO2 = 16, JUMP_EXCESS_PX2 = 4;  // as in dewarp/sampling.py

bool is_missing(float square, float opposite) {
    return (square != square) | (square > JUMP_RATIO2 * opposite + JUMP_EXCESS_PX2);
}

float sharpness_scale(float square, float sharp2) {
    const float ratio = sharp2 / square, squared = ratio * ratio;
    return square > sharp2 ? 1 - squared * squared : 0;
}

// A missing neighbour is replaced by the opposite one. Exception: if a coordinate is NaN and the field limits are
// unknown, the field may end there, and the pixel is not averaged.
void footprint_sides(const Neighbourhood& n, int place, int to_next, int count, const Footprints& f, Sides& sides) {
    const float *x = n.xs + place, *y = n.ys + place;
    const float *x0 = x - to_next, *y0 = y - to_next, *x1 = x + to_next, *y1 = y + to_next;
    float *__restrict left = sides.x[0], *__restrict up = sides.y[0];
    float *__restrict right = sides.x[1], *__restrict down = sides.y[1];
    const bool is_known = f.max2 > 0;
    const float sharp2 = f.sharp2;
    for (int i = 0; i < count; ++i) {
        const float dx0 = x0[i] - x[i], dy0 = y0[i] - y[i], square0 = dx0 * dx0 + dy0 * dy0;
        const float dx1 = x1[i] - x[i], dy1 = y1[i] - y[i], square1 = dx1 * dx1 + dy1 * dy1;
        const bool missing0 = is_missing(square0, square1), missing1 = is_missing(square1, square0);
        const bool ends = (square0 != square0) | (square1 != square1);
        const bool none = (missing0 & missing1) | (ends & !is_known);
        const float scale0 = sharpness_scale(missing0 ? square1 : square0, sharp2);
        const float scale1 = sharpness_scale(missing1 ? square0 : square1, sharp2);
        const float to_left = missing0 ? -dx1 : dx0, to_right = missing1 ? -dx0 : dx1;
        const float upwards = missing0 ? -dy1 : dy0, downwards = missing1 ? -dy0 : dy1;
        left[i] = none ? 0 : scale0 * to_left, up[i] = none ? 0 : scale0 * upwards;
        right[i] = none ? 0 : scale1 * to_right, down[i] = none ? 0 : scale1 * downwards;
    }
}

// t ranges from -0.5, half way to the previous neighbour, to 0.5. If sides is nullptr, coordinates are copied
// unchanged.
void move(const float* x, const float* y, const Sides* sides, float t, int count, float* __restrict x_to,
          float* __restrict y_to) {
    if (!sides) {
        std::memcpy(x_to, x, sizeof *x * static_cast<size_t>(count));
        std::memcpy(y_to, y, sizeof *y * static_cast<size_t>(count));
        return;
    }
    const float *dx = sides->x[t < 0 ? 0 : 1], *dy = sides->y[t < 0 ? 0 : 1];
    const float part = t < 0 ? -t : t;
    for (int i = 0; i < count; ++i) x_to[i] = x[i] + part * dx[i], y_to[i] = y[i] + part * dy[i];
}

// Set x to NaN outside the annular field of view.
void mask_outside_annulus(const Footprints& f, int count, float* __restrict x, const float* __restrict y) {
    for (int i = 0; i < count; ++i) {
        const float dx = x[i] - f.x_centre, dy = y[i] - f.y_centre, square = dx * dx + dy * dy;
        x[i] = (square >= f.min2) & (square <= f.max2) ? x[i] : UNDEFINED;
    }
}

float tap_at(int i, int count) { return (static_cast<float>(i) + 0.5f) / static_cast<float>(count) - 0.5f; }

// Means of up to 8 pixels with some taps outside the image: the mean of the taps inside, or a plain sample of the pixel
// if no tap is inside.
template <int C, class T>
void partial_means(const Job& job, const Sum<T>* sums, const uint16_t* inside, const Block<Fraction<T>>& middle,
                   int count, T* out) {
    for (int i = 0; i < count; ++i) {
        if (inside[i] == 0)
            sample_pixel<Interpolation::cubic, C>(job, middle.offsets[i], middle.fx[i], middle.fy[i], out + i * C);
        else
            for (int c = 0; c < C; ++c) out[i * C + c] = mean_of<T>(sums[place_of_sum<C>(i) + c], inside[i]);
    }
}

bool all_equal(const uint16_t* values, int count, int wanted) {
    int differing = 0;
    for (int i = 0; i < count; ++i) differing |= values[i] ^ wanted;
    return !differing;
}

// Sides are not computed along an axis with a single tap.
template <class Isa, class Sums, int C, class T>
void average_strip(const Job& job, const Neighbourhood& n, int place, int count, int across, int down, T* out) {
    using F = Fraction<T>;
    const Geometry& g = job.source.geometry;
    const int padded = round_up8(count);
    const Footprints& f = job.footprints;
    Sides horizontal, vertical;
    if (across > 1) footprint_sides(n, place, 1, padded, f, horizontal);
    if (down > 1) footprint_sides(n, place, Neighbourhood::STRIDE, padded, f, vertical);
    alignas(64) Sum<T> sums[STRIP * CHANNELS_OF_SUMS<C>];
    alignas(16) uint16_t inside[STRIP];
    std::memset(sums, 0, sizeof *sums * static_cast<size_t>(padded * CHANNELS_OF_SUMS<C>));
    std::memset(inside, 0, sizeof *inside * static_cast<size_t>(padded));
    alignas(64) float x_across[STRIP], y_across[STRIP], x[STRIP], y[STRIP];
    alignas(64) Block<F> blocks[STRIP / 8];
    for (int i = 0; i < across; ++i) {
        move(n.xs + place, n.ys + place, across > 1 ? &horizontal : nullptr, tap_at(i, across), padded, x_across,
             y_across);
        for (int j = 0; j < down; ++j) {
            move(x_across, y_across, down > 1 ? &vertical : nullptr, tap_at(j, down), padded, x, y);
            if (f.max2 > 0) mask_outside_annulus(f, padded, x, y);
            Isa::template locate<Interpolation::cubic>(x, y, padded, g, blocks);
            Sums::template add_taps<C, T>(job.source, blocks, padded, sums, inside);
        }
    }
    const bool is_whole = all_equal(inside, count, across * down);
    if (!is_whole) Isa::template locate<Interpolation::cubic>(n.xs + place, n.ys + place, padded, g, blocks);
    for (int i = 0; i < count; i += 8) {
        const Sum<T>* eight = sums + i * CHANNELS_OF_SUMS<C>;
        if (count - i >= 8 && all_equal(inside + i, 8, across * down))
            Sums::template mean_of_8<C, T>(eight, across * down, out + i * C);
        else
            partial_means<C, T>(job, eight, inside + i, blocks[i / 8], min_of(count - i, 8), out + i * C);
    }
}

template <class Isa, class Sums, int C, class T>
void average_part(const Job& job, const Tile& part, int across, int down) {
    Neighbourhood n;
    n.find<Isa>(job, part);
    for (Cursor at(part); !at.is_done(); at.advance()) {
        const int place = Neighbourhood::place(at.row - part.top, at.column - part.left);
        average_strip<Isa, Sums, C, T>(job, n, place, at.width(), across, down,
                                       reinterpret_cast<T*>(target_address<C, T>(job, at.row, at.column)));
    }
}

// Adjacent cells of a row with equal tap counts are processed together.
template <class Isa, class Sums, int C, class T>
void average_tile(const Job& job, const Tile& tile) {
    const Footprints& f = job.footprints;
    for (int top = tile.top; top < tile.bottom;) {
        const int bottom = min_of(tile.bottom, min_of(top + BLOCK_ROWS, (top / f.step + 1) * f.step));
        const uint8_t* taps = f.taps + static_cast<ptrdiff_t>(top / f.step) * f.columns * 2;
        for (int left = tile.left; left < tile.right;) {
            int cell = left / f.step, right = left;
            const int across = taps[2 * cell], down = taps[2 * cell + 1];
            do {
                right = min_of(++cell * f.step, tile.right);
            } while (right < tile.right && taps[2 * cell] == across && taps[2 * cell + 1] == down);
            const Tile part{top, bottom, left, right};
            if (across * down == 1)
                sample_tile<Isa, Interpolation::cubic, C, T>(job, part);
            else
                average_part<Isa, Sums, C, T>(job, part, across, down);
            left = right;
        }
        top = bottom;
    }
}

template <class Isa, class Sums, int C>
void average_of_depth(const Job& job, const Tile& tile) {
    switch (job.source.depth) {
        case Depth::u8: return average_tile<Isa, Sums, C, uint8_t>(job, tile);
        case Depth::u16: return average_tile<Isa, Sums, C, uint16_t>(job, tile);
        case Depth::f32: return average_tile<Isa, Sums, C, float>(job, tile);
    }
}

template <class Isa, class Sums>
void average(const Job& job, const Tile& tile) {
    switch (job.source.channels) {
        case 1: return average_of_depth<Isa, Sums, 1>(job, tile);
        case 2: return average_of_depth<Isa, Sums, 2>(job, tile);
        case 3: return average_of_depth<Isa, Sums, 3>(job, tile);
        case 4: return average_of_depth<Isa, Sums, 4>(job, tile);
    }
}

}  // namespace
}  // namespace omnimirror
