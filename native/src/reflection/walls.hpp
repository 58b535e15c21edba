// Rays through a transparent shell: both surfaces refract them by Snell's law.
//
// Formulas: src/omnimirror/optics/tracing/shell_transmission.py; the shell is symmetric about the z axis.
#pragma once

#include <cstdint>

namespace omnimirror {

enum class WallKind { WINDOW, TUBE, DOME };

struct Wall {
    WallKind kind;
    double places[2];  // heights of the surfaces of a window, or of the centres of a dome
    double radii[2];   // of the inner and the outer surface
    double index;      // relative to inside
    double outside;    // refractive index outside the shell
};

constexpr int WALL_VECTORS = 5, WALL_NUMBERS = 4;

struct WallJob {
    Wall wall;
    const double *points, *directions;  // (count, 3)
    long count;
    double* vectors[WALL_VECTORS];  // (count, 3): exit points and directions, points on the inner surface, directions
                                    // up to there, and its normals, pointing inwards
    double* numbers[WALL_NUMBERS];  // (count,): distances to and within the shell, incidence cosines before and behind
    std::uint8_t *meets, *passes;   // (count,)
};

void leave(const WallJob& job);

}  // namespace omnimirror
