// Working arrays, reused for one design after the other. Angles are stored in lanes; the padding lanes repeat the last
// angle.
#pragma once

#include <memory>

#include "designs.hpp"
#include "lanes.hpp"

namespace omnimirror {
namespace {

constexpr double DEGREE = 3.14159265358979323846 / 180;
constexpr int PARABOLAS = 18;  // of a real lens: see RealAreas

struct Workspace {
    int lanes;
    double *sag, *rise, *bend;                             // the basis: (terms, lanes) each
    double *fractions, *inverse_fractions, *near;          // near: inverse object distance
    double *z, *slope, *curvature;                         // of the mirror: z in units of its rim radius M, slope, M z''
    double *ray, *vergence_t, *vergence_s, *magnification_t, *magnification_s;
    double *shrinking;  // 1 / (M_t M_s)
    double *density;    // squared for ideal lenses, 1 for real ones; 0 for ignored angles
    double *seen;       // 1, or 0 below the base of the shell
    double* columns;    // (10, lanes)
    double *parabolas, *heights, *place;  // of real lenses: (18, lanes), (3, lanes), and pupil positions

    explicit Workspace(const DesignJob& job) : lanes(padded(job.angles)) {
        double** const single[] = {&fractions, &inverse_fractions, &near,     &z,         &slope,           &curvature,
                                   &ray,       &vergence_t,        &vergence_s, &magnification_t, &magnification_s,
                                   &shrinking, &density,           &seen,       &place};
        const int real = job.lens.values ? PARABOLAS + 3 : 0, rows = 3 * job.terms + DESIGN_COLUMNS + real;
        memory_.reset(new double[static_cast<std::size_t>(lanes) * (rows + sizeof single / sizeof *single)]);
        double* at = memory_.get();
        for (double** array : single) *array = at, at += lanes;
        columns = at, at += DESIGN_COLUMNS * lanes;
        parabolas = at, heights = at + PARABOLAS * lanes, at += real * lanes;
        sag = at, rise = sag + job.terms * lanes, bend = rise + job.terms * lanes;
        spread(job.sag, job.angles, job.terms, sag);
        spread(job.slope, job.angles, job.terms, rise);
        spread(job.curvature, job.angles, job.terms, bend);
        spread(job.fractions, job.angles, 1, fractions);
        spread(job.inverse_distance, job.angles, 1, near);
        for (int i = 0; i < lanes; ++i) inverse_fractions[i] = fractions[i] > 0 ? 1 / fractions[i] : 0.0, seen[i] = 1.0;
    }

    double* column(int c) const { return columns + c * lanes; }

  private:
    void spread(const double* from, int angles, int rows, double* to) const {
        for (int r = 0; r < rows; ++r)
            for (int i = 0; i < lanes; ++i)
                to[r * lanes + i] = from[static_cast<std::size_t>(r) * angles + (i < angles ? i : angles - 1)];
    }

    std::unique_ptr<double[]> memory_;
};

// Column indices: BATCH_COLUMNS of batch/evaluate.py.
enum Column { OMEGA, HEIGHT, DH, DW, VIEWPOINT, DISTANCE_T, DISTANCE_S, BLUR_T, BLUR_S, AREA };

}  // namespace
}  // namespace omnimirror
