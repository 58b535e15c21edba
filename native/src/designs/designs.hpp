// Designs by the thousand, as omnimirror.optics.batch.evaluate has them; the formulas are those of batch/closed_forms.py and
// batch/best_focus.py, and so are the steps.
#pragma once

#include <cstddef>

namespace omnimirror {

constexpr int DESIGN_COLUMNS = 10;
constexpr int DESIGN_NUMBERS = 7;
constexpr int LENS_ROWS = 27;    // of batch/closed_forms.py: place, motion, light, then eight by powers of the focus
constexpr int MOST_SCAN = 64;    // places that a focus is looked for at
constexpr int WALL_NUMBERS = 7;  // of one design: radii, heights, ends, whether it fits

// A real lens, tabulated: batch/closed_forms.py. Without values there is none.
struct LensTable {
    const double* values;  // (cells + 1, 2, LENS_ROWS)
    int cells;
    double end, f, f_number, e, pupil, least, most;  // least, most: vergences that it can be focused at
};

// The clear wall about one design: batch/closed_forms.py, Walls.
struct Wall {
    enum Kind { NONE, PLANE, CYLINDER, SPHERE };
    Kind kind;
    double inner_radius, outer_radius, inner_height, outer_height, base, cap;
    bool fits;
    double index, medium_index;
};

// How the best focus is looked for: numbers of batch/best_focus.py and optimisation.py, who say what they are.
struct FocusSearch {
    int scan;
    double margin, close;
    int most_steps;
    double edge;
    int halving;
};

struct DesignJob {
    // (designs, terms): what shapes each mirror; (designs, 7): distance, rim radius, focal length, F-number,
    // vertex radius, conic constant, magnification (0 under a perspective lens)
    const double* coefficients;
    const double* numbers;
    // (terms, angles): sag over M, slope, curvature times M; (angles): fractions of the rim radius, 1 over the
    // distance of the object
    const double* sag;
    const double* slope;
    const double* curvature;
    const double* fractions;
    const double* inverse_distance;
    int designs, terms, angles;
    bool has_conic, paper;
    double pitch, image_radius, wavelength, least_omega;  // image_radius 0: the real one
    FocusSearch search;
    LensTable lens;
    // (designs, 7): walls, where there is one; which, and the indices of it and of what is outside
    const double* walls;
    Wall::Kind wall_kind;
    double wall_index, medium_index;
    // (10, designs, angles), (designs), (designs), (designs)
    double* columns;
    double* focus;
    double* worst;
    double* valid;  // 1 or 0
};

void evaluate_designs(const DesignJob& job);

// Designs first to first + count.
using DesignKernel = void (*)(const DesignJob& job, int first, int count);
extern const DesignKernel plain_designs;
#if defined(OMNIMIRROR_AVX2)
extern const DesignKernel avx2_designs;
extern const DesignKernel avx512_designs;
#endif

}  // namespace omnimirror
