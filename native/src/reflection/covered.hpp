// Mirror points whose rays reach targets through a shell, by Newton's method; the meridian of the mirror is a table.
//
// Formulas: src/omnimirror/optics/tracing/optical_train.py. Derivatives are those of the complete path, by the chain
// rule.
#pragma once

#include <cstdint>

#include "reflection.hpp"
#include "walls.hpp"

namespace omnimirror {

// All quantities are in the frame of the shell, which is symmetric about the z axis.
struct CoveredJob {
    CubicPieces meridian;  // as a function of the distance from the mirror axis
    double cell, rim;      // mm
    Wall wall;
    double ends[2];            // heights; of a tube
    double turn[9], shift[3];  // of the mirror
    int steps;
    double longest, close;  // in rim radii: maximum step, and convergence tolerance
    const double *pupils, *targets;  // (count, 3): points, or directions to distant ones
    bool distant_pupils, distant_targets;
    long count;
    double* xy;  // (count, 2), in the mirror frame: initial values, replaced by the solution
    std::uint8_t* settled;
};

void find_covered(const CoveredJob& job);

}  // namespace omnimirror
