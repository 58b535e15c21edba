// Mirror points whose rays lead through a wall to targets, by Newton's rule, the mirror's meridian a table.
//
// Formulas: src/omnimirror/optics/tracing/optical_train.py. Derivatives are those of the whole way, by the chain rule.
#pragma once

#include <cstdint>

#include "reflection.hpp"
#include "walls.hpp"

namespace omnimirror {

// All of it in the frame of the wall, which stands about the axis z.
struct CoveredJob {
    CubicPieces meridian;  // by the distance from the mirror's axis
    double cell, rim;      // mm
    Wall wall;
    double ends[2];            // heights; of a tube
    double turn[9], shift[3];  // of the mirror
    int steps;
    double longest, close;  // of the rim radius: a step, and one after which there is none
    const double *pupils, *targets;  // (count, 3): points, or ways to distant ones
    bool distant_pupils, distant_targets;
    long count;
    double* xy;  // (count, 2) of the mirror: where to begin, and what is found
    std::uint8_t* settled;
};

void find_covered(const CoveredJob& job);

}  // namespace omnimirror
