// The plain kernels, and tile loops shared by all instruction sets.
#pragma once

#include "locate.hpp"
#include "pixel.hpp"

namespace omnimirror {
namespace {

struct Plain {
    template <Interpolation I, class Real, class F>
    static void locate(const Real* x, const Real* y, int count, const Geometry& g, Block<F>* blocks) {
        omnimirror::locate<I>(x, y, count, g, blocks);
    }

    template <Interpolation I, class F>
    static void locate_inner_cells(const Lattice& n, const CellRow& r, const Geometry& g, Block<F>* blocks) {
        alignas(64) float x[STRIP + 8], y[STRIP + 8];
        lattice_coordinates<Plain>(n, r, x, y);
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

// Panels are too narrow for the hardware to prefetch the destination of the next row.
void prefetch_target(uint8_t* out, int bytes) {
#if defined(__GNUC__)
    for (int i = 0; i < bytes; i += 64) __builtin_prefetch(out + i, 1);
#else
    (void)out, (void)bytes;
#endif
}

// Iterates over the strips of a tile, row by row.
struct Cursor {
    const Tile& tile;
    int row, column, index = 0;

    explicit Cursor(const Tile& t) : tile(t), row(t.top), column(t.left) {}
    bool is_done() const { return row >= tile.bottom; }
    int width() const { return min_of(STRIP, tile.right - column); }

    void advance() {
        ++index, column += STRIP;
        if (column >= tile.right) column = tile.left, ++row;
    }
};

// Locates the strips of a tile in sequence.
template <class Isa, Interpolation I, class F>
struct Locator {
    static constexpr int SLOTS = PREFETCH_STRIPS + 1;

    const Job& job;
    Cursor at, lattice_cursor;  // nodes are interpolated one strip ahead, to hide the latency
    CellRow cells[2];
    alignas(64) Block<F> blocks[SLOTS][STRIP / 8];

    Locator(const Job& j, const Tile& tile) : job(j), at(tile), lattice_cursor(tile) {
        if constexpr (I == Interpolation::nearest) std::memset(blocks, 0, sizeof blocks);  // nearest has no fractions
        interpolate_next();
    }

    Block<F>* of(int index) { return blocks[index % SLOTS]; }

    void interpolate_next() {
        if (job.map_type != MapType::lattice || lattice_cursor.is_done()) return;
        interpolate_cell_row(job.lattice, lattice_cursor.row, lattice_cursor.column, lattice_cursor.width(),
                             cells[lattice_cursor.index % 2]);
        lattice_cursor.advance();
    }

    void locate() {
        const int width = at.width();
        interpolate_next();
        if (job.map_type == MapType::lattice)
            locate_lattice<Isa, I>(job.lattice, job.source.geometry, cells[at.index % 2], width, of(at.index));
        else
            locate_strip<Isa, I>(job, at.row, at.column, width, of(at.index));
        at.advance();
    }
};

template <int C, class T>
uint8_t* target_address(const Job& job, int row, int column) {
    const ptrdiff_t pixel = C * static_cast<ptrdiff_t>(sizeof(T));
    return job.target.data + row * job.target.stride + column * pixel;
}

template <class Isa, Interpolation I, int C, class T>
void sample_packed_tile(const Job& job, const Tile& tile) {
    for (Cursor at(tile); !at.is_done(); at.advance()) {
        uint8_t* out = target_address<C, T>(job, at.row, at.column);
        const int width = at.width();
        if (at.row + 1 < tile.bottom) prefetch_target(out + job.target.stride, width * C * static_cast<int>(sizeof(T)));
        Isa::template sample_strip<I, C, T>(job, packed_strip<Fraction<T>>(job, at.row, at.column, width, out));
    }
}

template <class Isa, Interpolation I, int C, class T>
void sample_tile(const Job& job, const Tile& tile) {
    using F = Fraction<T>;
    if (job.map_type == MapType::packed) return sample_packed_tile<Isa, I, C, T>(job, tile);
    const bool is_prefetched = job.source.elements > MIN_PREFETCH_ELEMENTS;
    Locator<Isa, I, F> locator(job, tile);
    for (int i = 0; i < PREFETCH_STRIPS && !locator.at.is_done(); ++i) locator.locate();
    for (Cursor at(tile); !at.is_done(); at.advance()) {
        uint8_t* out = target_address<C, T>(job, at.row, at.column);
        const int width = at.width();
        if (at.row + 1 < tile.bottom) prefetch_target(out + job.target.stride, width * C * static_cast<int>(sizeof(T)));
        const Block<F>* prefetched = nullptr;
        if (!locator.at.is_done()) {
            const int located_index = locator.at.index;
            const bool is_as_wide = locator.at.width() >= width;
            locator.locate();
            if (is_prefetched && is_as_wide) prefetched = locator.of(located_index);
        }
        Isa::template sample_strip<I, C, T>(job, {locator.of(at.index), width, out, prefetched});
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
            const int count = min_of(STRIP, p.width - column);
            Block<F>* blocks = static_cast<Block<F>*>(p.blocks) + panel_block_index(p.rows, p.width, row, column);
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
