// Rays through a transparent shell: both surfaces refract them by Snell's law.
//
// Formulas: src/omnimirror/optics/tracing/shell_transmission.py; the shell is symmetric about the z axis.
#pragma once

#include <cstdint>

namespace omnimirror {

enum class ShellKind { WINDOW, TUBE, DOME };

struct Shell {
    ShellKind kind;
    double heights[2];  // heights of the surfaces of a window, or of the centres of a dome
    double radii[2];    // of the inner and the outer surface
    double index;       // relative to inside
    double outside;     // refractive index outside the shell
};

constexpr int SHELL_VECTORS = 5, SHELL_NUMBERS = 4;

struct ShellJob {
    Shell shell;
    const double *points, *directions;  // (count, 3)
    long count;
    double* vectors[SHELL_VECTORS];  // (count, 3): exit points and directions, points on the inner surface, directions
                                     // up to there, and its normals, pointing inwards
    double* numbers[SHELL_NUMBERS];  // (count,): distances to and within the shell, incidence cosines before and behind
    std::uint8_t *meets, *passes;    // (count,)
};

void shell_exit(const ShellJob& job);

}  // namespace omnimirror
