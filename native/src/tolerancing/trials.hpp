// Sensors with errors: where each shows the objects of a field, how it blurs them, what calibrations leave.
//
// Formulas: src/omnimirror/manufacturing/tolerancing: perturbed_states.py, trial_images.py, compensation.py.
#pragma once

#include <cstdint>

namespace omnimirror {

// Numbers of a trial, in this order; polynomial and form follow.
enum TrialNumber : int {
    ROTATION = 0,       // 9: from the mirror's frame to the camera's, by rows
    SHIFT = 9,          // 3: vertex in the camera frame, mm
    PUPIL = 12,         // 3: centre of the entrance pupil in the mirror's frame, mm
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
constexpr int MOST_POSE = 5, MOST_BASIS = 20, MOST_ROWS = 16;
constexpr int MOST_FORM_ORDER = 12;

enum Refocus : int { NOT_REFOCUSED = 0, LEAST_RMS = 1, LEAST_WORST = 2 };

// A table of quintic pieces, for mirrors without a formula; pieces is 0 of others.
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
    const double* affine;    // (affine_rows, 2 n), the first two of them shifts
    const double* basis;     // (basis_rows, 2 n)
    const double* straight;  // (basis_rows, pose)
    const double* bent;      // (basis_rows, pose (pose + 1) / 2)
    const double* radial;    // (radial_rows, 2 n)
    int affine_rows, basis_rows, pose, radial_rows;
    int rounds;
};

struct TrialSearch {
    int steps;         // most of Newton's rule
    double close;      // of the rim radius, where it ends
    double reflects;   // largest miss of the law of reflection
    double rim_slack;  // of the rim radius
    int halvings;      // of the golden section of a focus
};

struct TrialJob {
    const double* numbers;  // (trials, TRIAL_NUMBERS + terms + powers)
    int trials, terms, powers;
    bool is_conic;  // whether curvatures are other than 0
    double rim;
    RadialPieces table;
    TrialField field;
    TrialCompensators compensators;
    TrialSearch search;
    Refocus refocus;
    double floor;    // px^2
    double* merits;  // (trials, TRIAL_MERITS): as merit_names() says; NaN where rays are lost
    double* moved;   // (trials, 2 n) px, x of all objects and then y; or null
};

// How many terms and powers a trial may have: kernels are compiled for these.
bool is_valid_term_count(int terms);    // 0, 4, 8, 16
bool is_valid_power_count(int powers);  // 1 (none), 15, 28, 91

void judge_trials(const TrialJob& job);

// Of trials first to first + count.
using TrialKernel = void (*)(const TrialJob& job, int first, int count);
extern const TrialKernel plain_trials;
#if defined(OMNIMIRROR_AVX2)
extern const TrialKernel avx2_trials;
#endif

}  // namespace omnimirror
