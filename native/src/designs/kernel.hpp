// Kernel of designs.hpp. Compiled once per instruction set; therefore, everything has internal linkage.
#pragma once

#include "focus.hpp"
#include "ideal_points.hpp"
#include "real_design.hpp"

namespace omnimirror {
namespace {

// Conversion of vergences and ray coordinates by an ideal lens and its pixels.
struct Camera {
    double f, mu, blur, image, airy;  // airy: per mm of image distance; with a telecentric lens, the disc itself
    bool telecentric, scaled, paper;

    Camera(const DesignJob& job, const double* number, double rim_ray)
        : f(number[2]), mu(number[6]), telecentric(number[6] > 0), scaled(job.image_radius > 0), paper(job.paper) {
        const double F = number[3], disc = 2.44e-6 * job.wavelength * F / job.pitch;
        blur = telecentric ? mu * mu / (F * job.pitch) : f / (F * job.pitch) * (paper ? f : 1.0);
        image = scaled ? job.image_radius / rim_ray : (telecentric ? mu : 1.0) / job.pitch;
        airy = telecentric ? disc : disc / f;
    }

    AreaModel model() const {
        const double ratio = blur / (image * DEGREE), delta = ratio * ratio * ratio * ratio, per_blur = 1 / (blur * blur);
        if (telecentric) return {UNBOUNDED, 0.0, (1 + airy * airy) * per_blur, delta, true, 0, -UNBOUNDED, UNBOUNDED};
        return {1 / f, airy * airy, per_blur, delta, paper, int(paper) - int(scaled), 1e-7 / f, 0.999 / f};
    }
};

// Columns of a design with an ideal lens focused at a vergence, from the optics of its mirror points.
inline void fill_ideal(const Camera camera, double v, const Workspace& w) {
    const double b = camera.telecentric ? 1.0 : 1 / (1 / camera.f - v);
    const double ray_px = camera.image * (camera.scaled ? 1.0 : b), field_px = ray_px * DEGREE;
    const double vergence_px = camera.blur * (camera.paper ? 1.0 : b);
    const double airy = camera.airy * b, floor = 1 + airy * airy, per_area = 1 / (field_px * field_px);
    double* OMNIMIRROR_RESTRICT out = w.columns;
    const int n = w.lanes;
    for (int k = 0; k < n; k += LANE) {
        OMNIMIRROR_LANES(j, k) {
            const double t = vergence_px * (v - w.vergence_t[j]), s = vergence_px * (v - w.vergence_s[j]);
            out[OMEGA * n + j] *= 1 / DEGREE;
            out[HEIGHT * n + j] = w.ray[j] * ray_px;
            out[DH * n + j] = w.magnification_t[j] * field_px;
            out[DW * n + j] = w.magnification_s[j] * field_px;
            out[DISTANCE_T * n + j] = camera.telecentric ? -w.vergence_t[j] : 1 / w.vergence_t[j];
            out[DISTANCE_S * n + j] = camera.telecentric ? -w.vergence_s[j] : 1 / w.vergence_s[j];
            out[BLUR_T * n + j] = t;
            out[BLUR_S * n + j] = s;
            out[AREA * n + j] = sqrt_of((t * t + floor) * (s * s + floor)) * (w.inverse_magnification[j] * per_area);
        }
    }
}

// Columns of a design at its best focus.
void focus_ideal(const DesignJob& job, int design, const Workspace& w) {
    const Camera camera(job, job.numbers + static_cast<std::size_t>(design) * DESIGN_NUMBERS, w.ray[job.angles - 1]);
    const End best = best_vergence(job.search, IdealAreas(camera.model(), w));
    fill_ideal(camera, best.v, w);
    job.focus[design] = camera.telecentric ? -best.v : 1 / best.v;
    job.max_area[design] = sqrt_of(best.max_area.value);
}

// Copy to the output, without the padding lanes.
void copy_columns(const DesignJob& job, int design, const Workspace& w) {
    for (int c = 0; c < DESIGN_COLUMNS; ++c) {
        double* to = job.columns + (static_cast<std::size_t>(c) * job.designs + design) * job.angles;
        __builtin_memcpy(to, w.column(c), static_cast<std::size_t>(job.angles) * sizeof(double));
    }
}

// Compute the mirror points of a design with an ideal lens; return whether the design is valid.
inline bool trace_ideal_points(const DesignJob& job, int design, const Workspace& w) {
    const double* number = job.numbers + static_cast<std::size_t>(design) * DESIGN_NUMBERS;
    const double m = number[0], M = number[1];
    const bool is_telecentric = number[6] > 0;
    return is_telecentric ? fill_points(Telecentric{}, M, job.min_omega, w)
                          : fill_points(Perspective{m}, M, job.min_omega, w);
}

void evaluate_one(const DesignJob& job, const Lens& lens, int design, const Workspace& w) {
    if (job.has_conic)
        fill_profile<true>(job, design, w);
    else
        fill_profile<false>(job, design, w);
    const bool is_built = lens.is_tabulated() || job.shell_kind != DesignShell::NONE;
    const bool valid = is_built ? trace_real_points(job, design, lens, w) : trace_ideal_points(job, design, w);
    if (lens.is_tabulated())
        focus_real(job, design, lens, w);
    else
        focus_ideal(job, design, w);
    if (job.shell_kind != DesignShell::NONE) blank_invisible(w);
    job.valid[design] = valid;
    copy_columns(job, design, w);
}

void evaluate_batch(const DesignJob& job, int first, int count) {
    const Workspace workspace(job);
    const Lens lens(job.lens);
    for (int i = first; i < first + count; ++i) evaluate_one(job, lens, i, workspace);
}

}  // namespace
}  // namespace omnimirror
