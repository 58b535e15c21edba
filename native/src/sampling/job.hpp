// What is to be sampled, from where, to where: plain data, shared by all instruction sets.
#pragma once

#include <cstddef>
#include <cstdint>

#include "axial.hpp"

namespace omnimirror {

enum class Interpolation { nearest = 0, linear = 1, cubic = 2 };
enum class Depth { u8 = 0, u16 = 1, f32 = 2 };

// Every output pixel is described by the offset of one source pixel and two fractions. The offset counts
// elements (bytes of a uint8 picture) from the first pixel. Two kinds of pixel are told by the upper bit:
constexpr uint32_t OUTSIDE = 0xffffffffu;  // not in the field: becomes the border colour
constexpr uint32_t EDGE = 0x80000000u;     // cubic taps beyond the picture: the edge is repeated, slowly
constexpr int64_t LARGEST_OFFSET = 0x7fff0000;

constexpr int STRIP = 64;   // output pixels described at a time, in the first-level cache
constexpr int PANEL = 128;  // columns of the output that are worked on together, so that source pixels stay in a cache

// 8 adjoining output pixels. Fractions F are uint8_t in 255ths of a pixel, or uint16_t in 65535ths.
template <class F>
struct Block {
    uint32_t offsets[8];
    F fx[8], fy[8];
};

// Pictures narrower or lower than this are copied into a larger one that repeats their edge, so that no
// kernel has to think of pictures smaller than its loads.
constexpr int SMALLEST_SIDE = 16;

// The source picture as the kernels need it: pixels adjoin, rows are row_step elements apart.
struct Geometry {
    int width, height;              // where coordinates are valid: -0.5 to width - 0.5
    int x0_max, y0_max;             // the last pixel that has a right or lower neighbour in memory
    uint32_t pixel_step, row_step;  // in elements
    // Pixels x0 in [x_inner, x_inner + x_span] and likewise y0 need no repeated edge.
    int x_inner, y_inner;
    uint32_t x_span, y_span;
};

struct Source {
    const uint8_t* data;
    Depth depth;
    int channels;
    int64_t elements;  // from the first to the last that may be read
    Geometry geometry;
};

struct Target {
    uint8_t* data;
    int width, height;
    ptrdiff_t stride;  // bytes; pixels adjoin
};

// Where output pixels look: one of these.
struct Coordinates {
    const uint8_t* data;   // (x, y) pairs that adjoin
    ptrdiff_t row_stride;  // bytes
    bool is_double;
};

constexpr int BEYOND = 16;  // values behind the end of some arrays that may be read but do not count

struct Polar {  // centre + radii[row] * (cosines, sines)[column]
    const float* radii;
    const float *cosines, *sines;  // and BEYOND
    float x, y;
    float reach;  // the largest cosine or sine there is
};

// States of cells that are interpolated; others are indices of patches.
constexpr int32_t INTERPOLATED = -1;
constexpr int32_t INNER = -2;  // and lie so far within the picture that nothing need be checked

struct Nodes {           // coordinates at every step-th pixel, from (-step, -step) on, interpolated bicubically
    const float *x, *y;  // (rows, columns), and BEYOND
    int rows, columns;
    int log2_step;
    const float* weights;      // (4, step) along a row, and BEYOND
    const float* row_weights;  // (4, step) down a column
    const int32_t* cells;  // (cell rows, cell columns), states
    const float* patches;  // (n, step, step, 2) coordinates of cells that must not be interpolated
    int cell_columns;
};

// Blocks in the order in which they are wanted: panel after panel, row after row, from left to right.
struct Packed {
    const void* blocks;  // of uint8_t or uint16_t, as is_deep says
    int rows, columns;
};

// Where in a packed map the block is that starts at a row and a column.
inline ptrdiff_t place_in_panels(int rows, int columns, int row, int column) {
    const int start = column / PANEL * PANEL;
    const int width = (columns - start < PANEL ? columns - start : PANEL) + 7;
    return static_cast<ptrdiff_t>(start / 8) * rows + static_cast<ptrdiff_t>(width / 8) * row + (column - start) / 8;
}

enum class Where { coordinates, polar, nodes, packed };

// Which output pixels are averages over their footprint in the picture, and of how many taps: so many across and
// down for each cell of step x step pixels. 1 x 1 is a plain sample.
constexpr int MOST_TAPS = 128;  // a side

struct Footprints {
    const uint8_t* taps;  // (cell rows, cell columns, 2), or nullptr: nothing is averaged
    int columns, step;
    // A side of a footprint of s px is shortened by the factor 1 - (sharp / s)^8, and to nothing up to sharp; this
    // is sharp^2.
    float sharp2;
    // Only what lies between two distances from a point of the picture is seen; unknown if most2 is 0.
    float x_centre, y_centre, least2, most2;
};

struct Job {
    Source source;
    Target target;
    Interpolation interpolation;
    uint8_t border[16];  // one pixel, in the source's depth
    Where where;
    Coordinates coordinates;  // beside a packed map too, where footprints are averaged
    Polar polar;
    Nodes nodes;
    Packed packed;
    Footprints footprints;
};

struct Tile {
    int top, bottom, left, right;  // left is a multiple of 8, and of the step of nodes
};

// A packed map that is being made: rows from top to bottom of coordinates.
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

// What each instruction set implements, in a translation unit of its own.
struct Kernels {
    const char* name;
    Level level;  // that much at least: what the other rooms go by
    void (*sample)(const Job&, const Tile&);
    void (*average)(const Job&, const Tile&);  // the same where there are footprints
    void (*pack)(const Packing&, int top, int bottom);
    void (*project)(const Axial&, const Targets&, int64_t first, int64_t last);
};

extern const Kernels plain_kernels;
extern const Kernels avx2_kernels;
extern const Kernels avx512_kernels;
extern const Kernels avx512_gather_kernels;
extern const Kernels neon_kernels;

}  // namespace omnimirror
