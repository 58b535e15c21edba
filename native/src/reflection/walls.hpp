// Rays out through a clear wall: both sides bend them by Snell's law.
//
// Formulas: src/omnimirror/optics/tracing/shell_transmission.py, in whose frame a wall stands about the axis z.
#pragma once

#include <cstdint>

namespace omnimirror {

enum class WallKind { WINDOW, TUBE, DOME };

struct Wall {
    WallKind kind;
    double places[2];  // heights of a window's sides, or of the centres of a dome's
    double radii[2];   // of the inner and the outer side
    double index;      // relative to inside
    double outside;    // index of what is outside
};

constexpr int WALL_VECTORS = 5, WALL_NUMBERS = 4;

struct WallJob {
    Wall wall;
    const double *points, *directions;  // (count, 3)
    long count;
    double* vectors[WALL_VECTORS];  // (count, 3): where and whereto rays leave, where they meet the inner side, whereto
                                    // until there, and its normals, inwards
    double* numbers[WALL_NUMBERS];  // (count,): ways until the inner side and within, cosines to the normals before and behind
    std::uint8_t *meets, *passes;   // (count,)
};

void leave(const WallJob& job);

}  // namespace omnimirror
