// Designs with a real lens, or behind a shell: batch/closed_forms.py.
#pragma once

#include "focus.hpp"
#include "real_rays.hpp"

namespace omnimirror {
namespace {

// The parabolas of a design with a real lens.
void fill_parabolas(const DesignJob& job, const Lens& lens, const RealAreas& areas, const Workspace& w) {
    const LensTable& table = lens.table();
    const double aperture_px = table.f / table.f_number / job.pitch, scale = DEGREE / job.pitch;
    double mean = 0.0;
    int known = 0;
    for (int j = 0; j < job.angles; ++j) {
        const double both = w.vergence_t[j] + w.vergence_s[j];
        if (both == both) mean += both, ++known;
    }
    const double guess = min_of(max_of(mean / known / 2, table.minimum), table.maximum), q = lens.defocus(guess);
    for (int j = 0; j < w.lanes; ++j) {
        double row[LENS_ROWS];
        lens.at(w.ray[j], LENS_ROWS, row);
        const double *h = row + 3, *rate = row + 6, *far_t = row + 9, *spread_t = row + 12, *far_s = row + 15,
                     *spread_s = row + 18, *own = row + 21;
        const auto at = [q](const double* c) { return c[0] + q * (c[1] + q * c[2]); };
        w.z[j] = w.vergence_t[j] - at(far_t) / at(spread_t) + guess;  // z and slope are no longer needed
        w.slope[j] = w.vergence_s[j] - at(far_s) / at(spread_s) + guess;
        w.pupil_position[j] = row[0];
        for (int i = 0; i < 3; ++i) {
            areas.power(RealAreas::T, i)[j] = aperture_px * (far_t[i] - spread_t[i] * w.vergence_t[j]);
            areas.power(RealAreas::S, i)[j] = aperture_px * (far_s[i] - spread_s[i] * w.vergence_s[j]);
            areas.power(RealAreas::OWN_T, i)[j] = own[i] / job.pitch;
            areas.power(RealAreas::OWN_S, i)[j] = own[3 + i] / job.pitch;
            areas.power(RealAreas::DH_OF, i)[j] = scale * rate[i] * w.magnification_t[j];
            areas.power(RealAreas::DW_OF, i)[j] =
                scale * w.magnification_s[j] * (w.ray[j] == 0 ? rate[i] : h[i] / w.ray[j]);
            w.heights[i * w.lanes + j] = h[i] / job.pitch;
        }
    }
}

// Columns of a design with a real lens at its best focus.
void focus_real(const DesignJob& job, int design, const Lens& lens, const Workspace& w) {
    const double disc = 2.44e-6 * job.wavelength * lens.table().f_number / job.pitch;
    const RealAreas areas(lens, disc, w);
    fill_parabolas(job, lens, areas, w);
    const End best = best_vergence(job.search, areas);
    const double q = lens.defocus(best.v), airy = areas.airy(q), floor = 1 + airy * airy;
    const int n = w.lanes;
    for (int j = 0; j < n; ++j) {
        const double dh = areas.at(RealAreas::DH_OF, j, q), dw = areas.at(RealAreas::DW_OF, j, q);
        const double sides = areas.side(RealAreas::T, j, q, floor) * areas.side(RealAreas::S, j, q, floor);
        w.column(OMEGA)[j] /= DEGREE;
        w.column(HEIGHT)[j] = w.heights[j] + q * (w.heights[n + j] + q * w.heights[2 * n + j]);
        w.column(DH)[j] = dh;
        w.column(DW)[j] = dw;
        w.column(DISTANCE_T)[j] = 1 / w.vergence_t[j] + w.pupil_position[j];
        w.column(DISTANCE_S)[j] = 1 / w.vergence_s[j] + w.pupil_position[j];
        w.column(BLUR_T)[j] = areas.at(RealAreas::T, j, q);
        w.column(BLUR_S)[j] = areas.at(RealAreas::S, j, q);
        w.column(AREA)[j] = sqrt_of(sides) / (dh * dw);
    }
    job.focus[design] = 1 / best.v + lens.table().pupil;
    job.max_area[design] = sqrt_of(best.max_area.value);
}

DesignShell shell_of(const DesignJob& job, int design) {
    if (job.shell_kind == DesignShell::NONE) return {DesignShell::NONE, 0, 0, 0, 0, 0, 0, true, 1.0, 1.0};
    const double* w = job.shells + static_cast<std::size_t>(design) * DESIGN_SHELL_NUMBERS;
    return {job.shell_kind, w[0], w[1], w[2], w[3], w[4], w[5], w[6] > 0, job.shell_index, job.medium_index};
}

// Equivalent of fill_points for a design with a real lens or behind a shell.
bool trace_real_points(const DesignJob& job, int design, const Lens& lens, const Workspace& w) {
    const double* number = job.numbers + static_cast<std::size_t>(design) * DESIGN_NUMBERS;
    const double m = number[0], M = number[1];
    const bool telecentric = number[6] > 0;
    const DesignShell shell = shell_of(job, design);
    bool valid = true;
    for (int j = 0; j < w.lanes; ++j) {
        const double x = w.fractions[j] * M, z = w.z[j] * M, slope = w.slope[j], curvature = w.curvature[j] / M;
        ChiefRay chief_ray{m + z, telecentric ? 0.0 : x / (m + z), 0.0};
        if (lens.is_tabulated()) {
            double rows[2];
            chief_ray.tangent = lens.chief_ray_tangent(x, m + z);
            lens.at(chief_ray.tangent, 2, rows);
            chief_ray = {m + z - rows[0], chief_ray.tangent, rows[1] * (1 + chief_ray.tangent * chief_ray.tangent)};
            valid &= chief_ray.tangent <= lens.table().end * (1 + 1e-12);
        }
        const double over_x = x > 0 ? slope / x : curvature;
        const Node node =
            real_point(x, z, slope, curvature, over_x, w.inverse_distance[j], chief_ray, telecentric, shell);
        valid &= node.usable;
        const bool counts = node.visible && node.omega >= job.min_omega;
        w.ray[j] = node.ray;
        w.magnification_t[j] = node.magnification_t;
        w.magnification_s[j] = node.magnification_s;
        w.vergence_t[j] = node.vergence_t;
        w.vergence_s[j] = node.vergence_s;
        w.inverse_magnification[j] = 1 / (node.magnification_t * node.magnification_s);
        w.density[j] = !counts               ? 0.0
                       : lens.is_tabulated() ? 1.0
                                             : w.inverse_magnification[j] * w.inverse_magnification[j];
        w.visible[j] = node.visible;
        w.column(OMEGA)[j] = node.omega;
        w.column(VIEWPOINT)[j] = node.viewpoint;
    }
    const int rim = job.angles - 1;
    for (int j = 0; j < rim; ++j) {  // invisible points: copies of the rim, without weight
        if (w.visible[j] > 0) continue;
        for (double* values : {w.magnification_t, w.magnification_s, w.vergence_t, w.vergence_s})
            values[j] = values[rim];
    }
    return valid;
}

// Set the columns of invisible points to NaN.
void blank_invisible(const Workspace& w) {
    for (int c = 0; c < DESIGN_COLUMNS; ++c)
        for (int j = 0; j < w.lanes; ++j)
            if (!(w.visible[j] > 0)) w.column(c)[j] = __builtin_nan("");
}

}  // namespace
}  // namespace omnimirror
