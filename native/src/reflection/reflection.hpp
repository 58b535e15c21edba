// Reflection points of scene points, and intersections of rays from the lens with the mirror; its meridian is a table.
//
// Formulas: src/omnimirror/interop/torch/_reflection.py. The optical path length from the pupil P via a mirror point to
// a target T has the gradient g = S^T (p + t), where p and t are the unit vectors from both ends to the point and S the
// tangents of the surface. Newton's method finds its zero, starting from the solution in the meridian of the target for
// an aligned mirror.
#pragma once

#include <cstdint>

namespace omnimirror {

// Cubic pieces with contiguous coefficients: of sag and slope (8), or of one function (4).
struct CubicPieces {
    const double* coefficients;
    int pieces;
};

struct ReflectionSurface {
    CubicPieces meridian;  // as a function of the distance from the axis
    double cell;           // width of a piece, mm
    double rim;            // mm
    double min_radius;     // mm: minimum distance of reflection points from the axis; above 0 at the tip of a cone
    double pupil[3];       // in the mirror frame, mm; direction to the pupil if telecentric
    bool telecentric;
};

struct ReflectionSearch {
    int steps, first_steps;  // maximum Newton steps, and those in the meridian
    double tolerance, first_tolerance;  // convergence tolerances, in rim radii
    double max_step;                    // maximum step, in rim radii
    double max_radius;                  // maximum distance of iterates beyond the rim, in rim radii
    double rim_slack;           // in rim radii
};

enum ReflectionState : std::uint8_t { NOT_VISIBLE = 0, VISIBLE = 1, NOT_CONVERGED = 2 };

constexpr int REFLECTION_ROWS = 8, INTERSECTION_ROWS = 6;

// Targets in the mirror frame, by components.
struct ReflectionJob {
    ReflectionSurface surface;
    ReflectionSearch search;
    CubicPieces by_omega;  // distance from the axis as a function of the field angle
    double omegas[2];      // field angles of its first and last node
    double middle;         // position on the axis from which the field angle is measured
    bool distant;
    const double* targets[3];
    long count;
    double* rows[REFLECTION_ROWS];  // x, y, z; slopes in x and y; inverse (xx, xy, yy) of the Hessian
    std::uint8_t* states;
};

// Rays from the lens.
struct IntersectionJob {
    ReflectionSurface surface;
    ReflectionSearch search;
    CubicPieces depth;  // distance along the axis as a function of the ray's tangent, for an aligned mirror
    double max_tangent;
    const double* directions[3];
    long count;
    double* rows[INTERSECTION_ROWS];  // x, y, z; slopes in x and y; ray parameter in lengths of the direction
    std::uint8_t* states;
};

void find_reflections(const ReflectionJob& job);
void intersect_mirror(const IntersectionJob& job);

// For rays first to first + count.
struct ReflectionKernel {
    void (*find)(const ReflectionJob& job, long first, int count);
    void (*intersect)(const IntersectionJob& job, long first, int count);
};
extern const ReflectionKernel plain_reflections;
#if defined(OMNIMIRROR_AVX2)
extern const ReflectionKernel avx2_reflections;
#endif

}  // namespace omnimirror
