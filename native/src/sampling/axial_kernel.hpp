// Projection of targets. With the distances a across and z along the axis, q = sin(Omega/2) of a direction t = (a, z)
// is sqrt((1 - z/|t|)/2), and of a point the root in solve_points. The pixel is centre + r(q) (right, down)/a, with r
// from a table that is linear in q.
//
// Targets are processed 8 at a time. Loops over lanes have no branches, so that compilers vectorise them, and
// comparisons are false for NaN. Internal linkage and no library calls, as in common.hpp.
#pragma once

#include "axial.hpp"
#include "common.hpp"

namespace omnimirror {
namespace {

constexpr int LANES = 8;
constexpr double ANGLE_TOLERANCE_RAD = 1e-9;  // radians; the rim itself is visible
constexpr double CONVERGENCE_TOLERANCE =
    1e-7;  // of sin(Omega/2): the error after a Newton step of this size is about its square
constexpr double MAX_ROOT_RESIDUAL =
    0.1;                        // less than any jump of the sine between two directions that differ by 360 degrees
constexpr int MAX_STEPS = 100;  // bisection alone requires 25

using Lane = double[LANES];

// sin and cos of half the angle between the axis and directions (across, along), without cancellation. The angle lies
// between -90 and 270 degrees; above 180 degrees, where the sine would decrease, it is mirrored.
void half_angles(const Lane& across, const Lane& along, Lane& sine, Lane& cosine) {
    for (int i = 0; i < LANES; ++i) {
        const double length = std::sqrt(across[i] * across[i] + along[i] * along[i]);
        const double more = std::sqrt((length + std::fabs(along[i])) / (2 * length));
        const double less = std::fabs(across[i]) / (2 * length * more);
        const bool is_ahead = along[i] > 0;
        const double s = is_ahead ? less : more, behind = is_ahead ? -less : 2 - more;
        sine[i] = across[i] < 0 ? behind : s;
        cosine[i] = is_ahead ? more : less;
    }
}

// Position in a table, extrapolated linearly beyond its ends.
struct Cell {
    int index[LANES];
    Lane fraction;
};

void find_cells(const Lane& q, double first, double per, int last, Cell& cell) {
    for (int i = 0; i < LANES; ++i) {
        const double position = (q[i] - first) * per;
        double inside = position > 0 ? position : 0;  // 0 for NaN
        inside = inside < last ? inside : last;
        cell.index[i] = static_cast<int>(inside);
        cell.fraction[i] = position - cell.index[i];
    }
}

// Project points (across >= 0, along): solve q = sin(phi(q)/2) with Newton's method and a shrinking bracket, where phi
// is the direction from the origin of the ray of q to the point. The left side minus the right side increases at every
// root, so the root is unique. Without a root, the result lies beyond the ends or is NaN.
void solve_points(const Axial& a, const Lane& across, const Lane& along, Lane& solution) {
    const double reach = a.last - a.first;
    Lane q, low, high, sine, cosine, from_viewpoint;
    for (int i = 0; i < LANES; ++i) from_viewpoint[i] = along[i] - a.viewpoint;
    half_angles(across, from_viewpoint, q, cosine);
    for (int i = 0; i < LANES; ++i) {
        q[i] = q[i] > a.first ? q[i] : a.first;
        q[i] = q[i] < a.last ? q[i] : a.last;
        low[i] = a.first - reach, high[i] = a.last + reach;  // so that the first step too far ends at the end
    }
    for (int step = 0; step < MAX_STEPS; ++step) {
        Cell cell;
        find_cells(q, a.first, a.origins_per, a.origins_last, cell);
        Lane dx, dz, x_rate, z_rate;
        for (int i = 0; i < LANES; ++i) {
            const double* origin = a.origins + 2 * static_cast<ptrdiff_t>(cell.index[i]);
            x_rate[i] = origin[2] - origin[0], z_rate[i] = origin[3] - origin[1];
            dx[i] = across[i] - (origin[0] + cell.fraction[i] * x_rate[i]);
            dz[i] = along[i] - (origin[1] + cell.fraction[i] * z_rate[i]);
        }
        half_angles(dx, dz, sine, cosine);
        int is_active = 0;
        for (int i = 0; i < LANES; ++i) {
            const double turn = (dx[i] * z_rate[i] - dz[i] * x_rate[i]) / (dx[i] * dx[i] + dz[i] * dz[i]);
            const double miss = q[i] - sine[i], rate = 1 - 0.5 * cosine[i] * turn * a.origins_per;
            low[i] = miss <= 0 ? q[i] : low[i];
            high[i] = miss >= 0 ? q[i] : high[i];
            const double newton = q[i] - miss / rate;
            const bool is_inside = (newton >= low[i]) & (newton <= high[i]);
            double next = is_inside ? newton : 0.5 * (low[i] + high[i]);
            next = next > a.first ? next : a.first;
            next = next < a.last ? next : a.last;
            is_active |= std::fabs(next - q[i]) > CONVERGENCE_TOLERANCE ? -1 : 0;
            // At an end of the bracket, the residual is the distance of the point beyond it. If bisection converges to
            // a jump, there is no root: the point is inside the mirror or in its shadow.
            const bool is_beyond = ((miss > 0) & (q[i] <= a.first)) | ((miss < 0) & (q[i] >= a.last));
            const double root = std::fabs(miss) < MAX_ROOT_RESIDUAL ? newton : NAN;
            solution[i] = is_beyond ? q[i] - miss : root;
            q[i] = next;
        }
        if (!is_active) break;
    }
}

void store_pixels(const Axial& a, const Targets& t, int64_t first, int count, const Lane& q, const Lane& right,
                  const Lane& down, const Lane& across) {
    Cell cell;
    find_cells(q, a.first, a.radii_per, a.radii_last, cell);
    Lane radius, u, v, excess;
    for (int i = 0; i < LANES; ++i) {
        const double* r = a.radii + cell.index[i];
        radius[i] = r[0] + cell.fraction[i] * (r[1] - r[0]);
    }
    const double from = a.first - ANGLE_TOLERANCE_RAD, to = a.last + ANGLE_TOLERANCE_RAD;
    const double minimum = a.radii[0], maximum = a.radii[a.radii_last + 1];
    for (int i = 0; i < LANES; ++i) {
        const bool off_axis = across[i] > 0;  // on the axis, any azimuth is valid
        const double r = radius[i] > 0 ? radius[i] : 0, scale = r / (off_axis ? across[i] : 1);
        u[i] = a.x + (off_axis ? scale * right[i] : r);
        v[i] = a.y + (off_axis ? scale * down[i] : 0);
        const double beyond_u = max_of(-u[i], u[i] - a.x_last) - EDGE_PX;
        const double beyond_v = max_of(-v[i], v[i] - a.y_last) - EDGE_PX;
        const double margin = max_of(beyond_u, beyond_v);
        const bool visible = (q[i] >= from) & (q[i] <= to) & (margin <= 0);
        excess[i] = visible ? 0 : max_of(max_of(radius[i] - maximum, minimum - radius[i]), margin);
        u[i] = visible ? u[i] : NAN;
        v[i] = visible ? v[i] : NAN;
    }
    for (int i = 0; i < count; ++i) t.pixels[2 * (first + i)] = u[i], t.pixels[2 * (first + i) + 1] = v[i];
    if (!t.excess) return;
    for (int i = 0; i < count; ++i) t.excess[first + i] = excess[i];
}

void project_targets(const Axial& camera, const Targets& t, int64_t first, int64_t last) {
    const Axial a = camera;
    for (int64_t at = first; at < last; at += LANES) {
        const int count = static_cast<int>(last - at < LANES ? last - at : LANES);
        Lane along, right, down, across, q, cosine;
        for (int i = 0; i < LANES; ++i) {
            const double* p = t.xyz + 3 * (at + (i < count ? i : 0));
            along[i] = a.axis[0] * p[0] + a.axis[1] * p[1] + a.axis[2] * p[2];
            right[i] = a.right[0] * p[0] + a.right[1] * p[1] + a.right[2] * p[2];
            down[i] = a.down[0] * p[0] + a.down[1] * p[1] + a.down[2] * p[2];
        }
        for (int i = 0; i < LANES; ++i) across[i] = std::sqrt(right[i] * right[i] + down[i] * down[i]);
        if (t.is_near && a.origins)
            solve_points(a, across, along, q);
        else
            half_angles(across, along, q, cosine);
        store_pixels(a, t, at, count, q, right, down, across);
    }
}

}  // namespace
}  // namespace omnimirror
