// Monte Carlo trials of sensors with errors: image positions and blur of the objects of a field, and residuals after
// calibration.
//
// Formulas: src/omnimirror/manufacturing/tolerancing: perturbed_states.py, trial_images.py, compensation.py.
#pragma once

#include <cstdint>

namespace omnimirror {

// Numbers of a trial, in this order, followed by polynomial and form error.
enum TrialNumber : int {
    ROTATION = 0,       // 9: from the mirror frame to the camera frame, by rows
    SHIFT = 9,          // 3: vertex in the camera frame, mm
    PUPIL = 12,         // 3: centre of the entrance pupil in the mirror frame, mm
    CURVATURE = 15,     // 1/mm
    CONIC = 16,
    APERTURE = 17,      // mm
    VERGENCE = 18,      // 1/mm
    BREATHING = 19,     // f - e, mm
    BROWN = 20,         // 5: k1, k2, k3, p1, p2
    IMAGER = 25,        // 9: from tangents to offsets in px, by rows
    FOCAL = 34,         // mm
    TRIAL_NUMBERS = 35
};

constexpr int CALIBRATION_DEPTHS = 5;
constexpr int TRIAL_MERITS = 4 * CALIBRATION_DEPTHS + 4;
constexpr int MAX_POSE_PARAMETERS = 5, MAX_BASIS_ROWS = 20, MAX_COMPENSATOR_ROWS = 16;
constexpr int MAX_FORM_ORDER = 12;

enum Refocus : int { NO_REFOCUS = 0, MIN_RMS = 1, MIN_MAX = 2 };

// A table of quintic pieces, for mirrors without a formula; otherwise, pieces is 0.
struct RadialPieces {
    const double* coefficients;  // (pieces, 6)
    int pieces;
    double step;
};

struct TrialField {
    const double* targets;     // (n, 3): unit directions or mm, in the camera frame
    const double* start;       // (n, 2): mirror points, mm
    const double* reference;   // (n, 2): px
    const double* deg_per_px;  // (n, 4)
    const double* area;        // (n): px^2 per deg^2
    int count;
    bool distant;
};

struct TrialCompensators {
    const double* affine;    // (affine_rows, 2 n); the first two are shifts
    const double* basis;     // (basis_rows, 2 n)
    const double* linear;    // (basis_rows, pose)
    const double* quadratic;  // (basis_rows, pose (pose + 1) / 2)
    const double* radial;    // (radial_rows, 2 n)
    int affine_rows, basis_rows, pose, radial_rows;
    int iterations;
};

struct TrialSearch {
    int steps;         // maximum Newton steps
    double tolerance;  // convergence tolerance, in rim radii
    double reflection_tolerance;  // maximum residual of the law of reflection
    double rim_slack;  // in rim radii
    int focus_steps;   // golden-section steps of the focus search
};

struct TrialJob {
    const double* numbers;  // (trials, TRIAL_NUMBERS + terms + powers)
    int evaluate_trials_binding, terms, powers;
    bool is_conic;  // whether any curvature is nonzero
    double rim;
    RadialPieces table;
    TrialField field;
    TrialCompensators compensators;
    TrialSearch search;
    Refocus refocus;
    double floor;    // px^2
    double* merits;  // (trials, TRIAL_MERITS), in the order of merit_names(); NaN if rays are lost
    double* displacements;  // (trials, 2 n) px, x of all objects and then y; or nullptr
};

// Valid numbers of terms and powers of a trial, for which kernels are compiled.
bool is_valid_term_count(int terms);    // 0, 4, 8, 16
bool is_valid_power_count(int powers);  // 1 (none), 15, 28, 91

void evaluate_trials(const TrialJob& job);

// For trials first to first + count.
using TrialKernel = void (*)(const TrialJob& job, int first, int count);
extern const TrialKernel plain_trials;
#if defined(OMNIMIRROR_AVX2)
extern const TrialKernel avx2_trials;
#endif

}  // namespace omnimirror
