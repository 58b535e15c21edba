// Description of a resampling job (source, coordinates, target): plain data, shared by all instruction sets.
#pragma once

#include <cstddef>
#include <cstdint>

#include "axial.hpp"

namespace omnimirror {

enum class Interpolation { nearest = 0, linear = 1, cubic = 2 };
enum class Depth { u8 = 0, u16 = 1, f32 = 2 };

// Each output pixel is described by the offset of one source pixel and two fractions. The offset counts elements (bytes
// of a uint8 image) from the first pixel. Two special cases are encoded in the upper bit:
constexpr uint32_t OUTSIDE = 0xffffffffu;  // outside the field: set to the border colour
constexpr uint32_t EDGE = 0x80000000u;     // cubic taps beyond the image: slow path that replicates the edge
constexpr int64_t MAX_ELEMENT_OFFSET = 0x7fff0000;

constexpr int STRIP = 64;   // output pixels processed at a time, in the L1 cache
constexpr int PANEL = 128;  // output columns processed together, so that source pixels stay in a cache

// 8 adjacent output pixels. Fractions F are uint8_t in units of 1/255 pixel, or uint16_t in units of 1/65535 pixel.
template <class F>
struct Block {
    uint32_t offsets[8];
    F fx[8], fy[8];
};

// Images narrower or lower than this are copied into a larger one with replicated edges, so that no kernel needs to
// handle images smaller than its loads.
constexpr int MIN_SIDE = 16;

// Geometry of the source image: pixels are contiguous; rows are row_step elements apart.
struct Geometry {
    int width, height;              // valid coordinates: -0.5 to width - 0.5
    int x0_max, y0_max;             // the last pixel with a right or lower neighbour in memory
    uint32_t pixel_step, row_step;  // in elements
    // Pixels x0 in [x_inner, x_inner + x_span], and likewise y0, need no edge replication.
    int x_inner, y_inner;
    uint32_t x_span, y_span;
};

struct Source {
    const uint8_t* data;
    Depth depth;
    int channels;
    int64_t elements;  // number of readable elements
    Geometry geometry;
};

struct Target {
    uint8_t* data;
    int width, height;
    ptrdiff_t stride;  // bytes; pixels are contiguous
};

// Source coordinates of output pixels, in one of the following forms.
struct Coordinates {
    const uint8_t* data;   // contiguous (x, y) pairs
    ptrdiff_t row_stride;  // bytes
    bool is_double;
};

constexpr int PADDING = 16;  // readable but unused values after the end of some arrays

struct Polar {  // centre + radii[row] * (cosines, sines)[column]
    const float* radii;
    const float *cosines, *sines;  // followed by PADDING values
    float x, y;
    float reach;  // the largest absolute cosine or sine
};

// States of interpolated cells; other values are indices of patches.
constexpr int32_t INTERPOLATED = -1;
constexpr int32_t INNER = -2;  // interpolated, and far enough inside the image to need no checks

struct Lattice {         // coordinates at every step-th pixel, from (-step, -step) on, interpolated bicubically
    const float *x, *y;  // (rows, columns), followed by PADDING values
    int rows, columns;
    int log2_step;
    const float* weights;      // (4, step) along a row, followed by PADDING values
    const float* row_weights;  // (4, step) down a column
    const int32_t* cells;  // (cell rows, cell columns), states
    const float* patches;  // (n, step, step, 2) coordinates of cells that must not be interpolated
    int cell_columns;
};

// Blocks in the order of access: by panels, then rows, from left to right.
struct Packed {
    const void* blocks;  // of uint8_t or uint16_t, according to is_deep
    int rows, columns;
};

// Index of the block of a packed map that starts at a given row and column.
inline ptrdiff_t panel_block_index(int rows, int columns, int row, int column) {
    const int start = column / PANEL * PANEL;
    const int width = (columns - start < PANEL ? columns - start : PANEL) + 7;
    return static_cast<ptrdiff_t>(start / 8) * rows + static_cast<ptrdiff_t>(width / 8) * row + (column - start) / 8;
}

enum class MapType { coordinates, polar, lattice, packed };

// Averages over footprints in the image: the number of taps across and down for each cell of step x step output pixels.
// 1 x 1 is a plain sample.
constexpr int MAX_TAPS = 128;  // per side

struct Footprints {
    const uint8_t* taps;  // (cell rows, cell columns, 2), or nullptr: no averaging
    int columns, step;
    // A footprint side of s px is scaled by 1 - (sharp / s)^8, or by 0 if s <= sharp; sharp2 is sharp^2.
    float sharp2;
    // The field of view is the annulus between two radii around a centre; unknown if most2 is 0.
    float x_centre, y_centre, min2, max2;
};

struct Job {
    Source source;
    Target target;
    Interpolation interpolation;
    uint8_t border[16];  // one pixel, in the depth of the source
    MapType map_type;
    Coordinates coordinates;  // also set with a packed map if footprints are averaged
    Polar polar;
    Lattice lattice;
    Packed packed;
    Footprints footprints;
};

struct Tile {
    int top, bottom, left, right;  // left is a multiple of 8 and of the step of nodes
};

// A packed map under construction: rows from top to bottom of coordinates.
struct Packing {
    Coordinates coordinates;
    Geometry geometry;
    Interpolation interpolation;
    int width;
    bool is_deep;
    int rows;
    void* blocks;
};

inline bool is_deep(Depth depth) { return depth != Depth::u8; }
inline int size_of(Depth depth) { return depth == Depth::u8 ? 1 : depth == Depth::u16 ? 2 : 4; }

enum class Level { PLAIN, AVX2, AVX512 };

// Kernels of one instruction set, implemented in a separate translation unit.
struct Kernels {
    const char* name;
    Level level;  // lower bound of the instruction set: selects the kernels of the other folders
    void (*sample)(const Job&, const Tile&);
    void (*average)(const Job&, const Tile&);  // sampling with footprints
    void (*pack)(const Packing&, int top, int bottom);
    void (*project)(const Axial&, const Targets&, int64_t first, int64_t last);
};

extern const Kernels plain_kernels;
extern const Kernels avx2_kernels;
extern const Kernels avx512_kernels;
extern const Kernels avx512_gather_kernels;
extern const Kernels neon_kernels;

}  // namespace omnimirror
