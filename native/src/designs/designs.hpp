// Evaluation of batches of designs, used by omnimirror.optics.batch.evaluate. Formulas and steps are those of
// batch/closed_forms.py and batch/best_focus.py.
#pragma once

#include <cstddef>

namespace omnimirror {

constexpr int DESIGN_COLUMNS = 10;
constexpr int DESIGN_NUMBERS = 7;
constexpr int LENS_ROWS = 27;    // batch/closed_forms.py: position, motion, light, then eight by powers of the focus
constexpr int MAX_SCAN_SAMPLES = 64;     // maximum samples of the initial focus scan
constexpr int DESIGN_SHELL_NUMBERS = 7;  // per design: radii, heights, ends, whether the shell fits

// A tabulated real lens: batch/closed_forms.py. values is nullptr without one.
struct LensTable {
    const double* values;  // (cells + 1, 2, LENS_ROWS)
    int cells;
    double end, f, f_number, e, pupil, minimum, maximum;  // least, most: limits of the focusable vergences
};

// The transparent shell of one design: batch/closed_forms.py, Walls.
struct DesignShell {
    enum Kind { NONE, PLANE, CYLINDER, SPHERE };
    Kind kind;
    double inner_radius, outer_radius, inner_height, outer_height, base, cap;
    bool fits;
    double index, medium_index;
};

// Parameters of the best-focus search, defined in batch/best_focus.py and optimisation.py.
struct FocusSearch {
    int scan;
    double margin, tolerance;
    int max_bracket_steps;
    double min_bracket_reduction;
    int bisection_period;
};

struct DesignJob {
    // (designs, terms): coefficients of each mirror; (designs, 7): distance, rim radius, focal length, F-number, vertex
    // radius, conic constant, magnification (0 with a perspective lens)
    const double* coefficients;
    const double* numbers;
    // (terms, angles): sag over M, slope, curvature times M; (angles): fractions of the rim radius, inverse object
    // distance
    const double* sag;
    const double* slope;
    const double* curvature;
    const double* fractions;
    const double* inverse_distance;
    int designs, terms, angles;
    bool has_conic, paper;
    double pitch, image_radius, wavelength, min_omega;  // image_radius 0: from focal length and pitch
    FocusSearch search;
    LensTable lens;
    // (designs, 7): shells, if any; their kind, and the refractive indices of shell and surrounding medium
    const double* shells;
    DesignShell::Kind shell_kind;
    double shell_index, medium_index;
    // (10, designs, angles), (designs), (designs), (designs)
    double* columns;
    double* focus;
    double* max_area;
    double* valid;  // 1 or 0
};

void evaluate_designs(const DesignJob& job);

// Evaluate designs first to first + count.
using DesignKernel = void (*)(const DesignJob& job, int first, int count);
extern const DesignKernel plain_designs;
#if defined(OMNIMIRROR_AVX2)
extern const DesignKernel avx2_designs;
extern const DesignKernel avx512_designs;
#endif

}  // namespace omnimirror
