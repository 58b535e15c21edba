// Where a mirror shows points of the world to its lens, and where rays from the lens meet it, its meridian a table.
//
// Formulas: src/omnimirror/interop/torch/_reflection.py. The way of light from the pupil P over a mirror point to a target T has
// the gradient g = S^T (p + t), p and t the unit vectors from both ends to the point and S the tangents of the surface;
// Newton's rule finds where it is 0, from where it is so in the meridian of the target, were the mirror in line.
#pragma once

#include <cstdint>

namespace omnimirror {

// Cubic pieces, coefficients of a piece beside each other: of sag and slope (8), or of one function (4).
struct CubicPieces {
    const double* coefficients;
    int pieces;
};

struct ReflectionSurface {
    CubicPieces meridian;  // by the distance from the axis
    double cell;           // width of a piece, mm
    double rim;            // mm
    double least;          // mm: no reflection is looked for nearer to the axis; above 0 at the tip of a cone
    double pupil[3];       // in the mirror's frame, mm; the way to it if telecentric
    bool telecentric;
};

struct ReflectionSearch {
    int steps, first_steps;  // most of Newton's rule, and of it in the meridian
    double close, first_close;  // of the rim radius: steps after which there is none
    double longest;             // step, of the rim radius
    double reach;               // how far beyond the rim points are followed, of its radius
    double rim_slack;           // of the rim radius
};

enum ReflectionState : std::uint8_t { NOT_SEEN = 0, SEEN = 1, NOT_SETTLED = 2 };

constexpr int SEEN_ROWS = 8, MET_ROWS = 6;

// Targets in the mirror's frame, by components.
struct SeenJob {
    ReflectionSurface surface;
    ReflectionSearch search;
    CubicPieces by_omega;  // distance from the axis by the field angle
    double omegas[2];      // of its first and last node
    double middle;         // where on the axis the field angle is taken
    bool distant;
    const double* targets[3];
    long count;
    double* rows[SEEN_ROWS];  // x, y, z; slopes by x and y; inverse (xx, xy, yy) of the second derivatives
    std::uint8_t* states;
};

// Rays from the lens.
struct MetJob {
    ReflectionSurface surface;
    ReflectionSearch search;
    CubicPieces depth;  // distance along the axis by the tangent of a ray, were the mirror in line
    double most_tangent;
    const double* ways[3];
    long count;
    double* rows[MET_ROWS];  // x, y, z; slopes by x and y; how many times its way the ray has gone
    std::uint8_t* states;
};

void find_reflections(const SeenJob& job);
void meet_mirror(const MetJob& job);

// Of rays first to first + count.
struct ReflectionKernel {
    void (*find)(const SeenJob& job, long first, int count);
    void (*meet)(const MetJob& job, long first, int count);
};
extern const ReflectionKernel plain_reflections;
#if defined(OMNIMIRROR_AVX2)
extern const ReflectionKernel avx2_reflections;
#endif

}  // namespace omnimirror
