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
    double *sag, *slope_basis, *curvature_basis;               // the basis: (terms, lanes) each
    double *fractions, *inverse_fractions, *inverse_distance;  // near: inverse object distance
    double *z, *slope, *curvature;                         // of the mirror: z in units of its rim radius M, slope, M z''
    double *ray, *vergence_t, *vergence_s, *magnification_t, *magnification_s;
    double* inverse_magnification;  // 1 / (M_t M_s)
    double *density;    // squared for ideal lenses, 1 for real ones; 0 for ignored angles
    double* visible;    // 1, or 0 below the base of the shell
    double* columns;    // (10, lanes)
    double *parabolas, *heights, *pupil_position;  // of real lenses: (18, lanes), (3, lanes), and pupil positions

    explicit Workspace(const DesignJob& job) : lanes(padded(job.angles)) {
        double** const single[] = {&fractions,
                                   &inverse_fractions,
                                   &inverse_distance,
                                   &z,
                                   &slope,
                                   &curvature,
                                   &ray,
                                   &vergence_t,
                                   &vergence_s,
                                   &magnification_t,
                                   &magnification_s,
                                   &inverse_magnification,
                                   &density,
                                   &visible,
                                   &pupil_position};
        const int real = job.lens.values ? PARABOLAS + 3 : 0, rows = 3 * job.terms + DESIGN_COLUMNS + real;
        memory_.reset(new double[static_cast<std::size_t>(lanes) * (rows + sizeof single / sizeof *single)]);
        double* at = memory_.get();
        for (double** array : single) *array = at, at += lanes;
        columns = at, at += DESIGN_COLUMNS * lanes;
        parabolas = at, heights = at + PARABOLAS * lanes, at += real * lanes;
        sag = at, slope_basis = sag + job.terms * lanes, curvature_basis = slope_basis + job.terms * lanes;
        copy_padded(job.sag, job.angles, job.terms, sag);
        copy_padded(job.slope, job.angles, job.terms, slope_basis);
        copy_padded(job.curvature, job.angles, job.terms, curvature_basis);
        copy_padded(job.fractions, job.angles, 1, fractions);
        copy_padded(job.inverse_distance, job.angles, 1, inverse_distance);
        for (int i = 0; i < lanes; ++i)
            inverse_fractions[i] = fractions[i] > 0 ? 1 / fractions[i] : 0.0, visible[i] = 1.0;
    }

    double* column(int c) const { return columns + c * lanes; }

  private:
    void copy_padded(const double* from, int angles, int rows, double* to) const {
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
