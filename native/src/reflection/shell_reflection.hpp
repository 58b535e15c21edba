// Mirror points whose rays reach targets through a shell, by Newton's method; the meridian of the mirror is a table.
//
// Formulas: src/omnimirror/optics/tracing/optical_train.py. Derivatives are those of the complete path, by the chain
// rule.
#pragma once

#include <cstdint>

#include "reflection.hpp"
#include "shell_transmission.hpp"

namespace omnimirror {

// All quantities are in the frame of the shell, which is symmetric about the z axis.
struct ShellReflectionJob {
    CubicPieces meridian;  // as a function of the distance from the mirror axis
    double cell, rim;      // mm
    Shell shell;
    double ends[2];                // heights; of a tube
    double rotation[9], shift[3];  // of the mirror
    int steps;
    double max_step, tolerance;      // in rim radii: maximum step, and convergence tolerance
    const double *pupils, *targets;  // (count, 3): points, or directions to distant ones
    bool distant_pupils, distant_targets;
    long count;
    double* xy;  // (count, 2), in the mirror frame: initial values, replaced by the solution
    std::uint8_t* converged;
};

void find_reflections_through_shell(const ShellReflectionJob& job);

}  // namespace omnimirror
