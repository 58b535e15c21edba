#include "shell_reflection.hpp"

#include "batches.hpp"
#include "shell_rays.hpp"

namespace omnimirror {
namespace {

constexpr int TARGETS_PER_TASK = 512;
constexpr double ON_AXIS = 1e-24;      // mm^2, added to squared distances from the axis
constexpr double MAX_RESIDUAL = 1e-3;  // larger residuals are not converged, however short the step (at a mirror's tip)

using DualVector = Vector<Dual>;

DualVector fixed(const double* row) { return {{row[0]}, {row[1]}, {row[2]}}; }

DualVector rotated(const double* by, DualVector v) {
    return {by[0] * v.x + by[1] * v.y + by[2] * v.z, by[3] * v.x + by[4] * v.y + by[5] * v.z,
            by[6] * v.x + by[7] * v.y + by[8] * v.z};
}

struct SurfacePoint {
    DualVector at, normal;  // towards the lens
};

// Mirror surface at (x, y) in its own frame, extrapolated quadratically beyond the table.
SurfacePoint surface_point(const ShellReflectionJob& job, double x, double y) {
    const Dual mx{x, 1, 0}, my{y, 0, 1}, r = root(mx * mx + my * my + ON_AXIS);
    const double pieces = job.meridian.pieces, place = r.v / job.cell;
    const double position = place < pieces ? place : pieces;  // NaN is assigned to the last piece
    const int piece = std::min(static_cast<int>(position), job.meridian.pieces - 1);
    const double* c = job.meridian.coefficients + 8 * piece;
    const double t = position - piece, beyond = r.v - position * job.cell;
    const double bend = (c[5] + t * (2 * c[6] + t * (3 * c[7]))) / job.cell;
    const double steep = c[4] + t * (c[5] + t * (c[6] + t * c[7])), slope = steep + bend * beyond;
    const double sag = c[0] + t * (c[1] + t * (c[2] + t * c[3])) + beyond * (steep + slope) / 2;
    const Dual tilt = Dual{slope, bend * r.x, bend * r.y} / r, sx = tilt * mx, sy = tilt * my;
    const Dual over = 1 / root(1 + sx * sx + sy * sy);
    const DualVector at = rotated(job.rotation, {mx, my, {sag, slope * r.x, slope * r.y}});
    return {{at.x + job.shift[0], at.y + job.shift[1], at.z + job.shift[2]},
            rotated(job.rotation, {over * sx, over * sy, -over})};
}

struct TargetResidual {
    DualVector residual, outwards;
};

// Vector by which the ray via a mirror point misses its target.
TargetResidual target_residual(const ShellReflectionJob& job, const double* pupil, const double* target, double x,
                               double y) {
    const SurfacePoint mirror = surface_point(job, x, y);
    const DualVector from = job.distant_pupils ? fixed(pupil) : fixed(pupil) - mirror.at;
    const DualVector to_pupil = (1 / length(from)) * from;
    const DualVector reflected = 2 * dot(to_pupil, mirror.normal) * mirror.normal - to_pupil;
    ShellExit<Dual> exit_ray = trace_shell(job.shell, mirror.at, reflected);
    const double height = exit_ray.inner_point.z.v;
    if (job.shell.kind == ShellKind::TUBE && job.shell.outside == 1.0 &&
        !((height > job.ends[0]) & (height < job.ends[1])))
        exit_ray.exit_point = mirror.at, exit_ray.outwards = reflected;
    if (job.distant_targets) return {exit_ray.outwards - fixed(target), exit_ray.outwards};
    const DualVector rest = fixed(target) - exit_ray.exit_point, whole = fixed(target) - mirror.at;
    const Dual over = 1 / length(whole);
    return {over * (dot(rest, exit_ray.outwards) * exit_ray.outwards - rest), exit_ray.outwards};
}

// Two unit vectors perpendicular to a third one and to each other (Duff et al., 2017).
struct Transverse {
    double first[3], second[3];
};

Transverse transverse(DualVector to) {
    const double x = to.x.v, y = to.y.v, z = to.z.v, sign = std::copysign(1.0, z), a = -1 / (sign + z), b = x * y * a;
    return {{1 + sign * x * x * a, sign * b, -sign * x}, {b, sign + y * y * a, -y}};
}

Dual component(const double* e, DualVector v) { return e[0] * v.x + e[1] * v.y + e[2] * v.z; }

void solve_one(const ShellReflectionJob& job, long i) {
    const double* const pupil = job.pupils + 3 * i;
    const double* const target = job.targets + 3 * i;
    double x = job.xy[2 * i], y = job.xy[2 * i + 1];
    const double max_step = job.max_step * job.rim, tolerance = job.tolerance * job.rim;
    bool converged = false;
    for (int step = 0; step < job.steps && !converged; ++step) {
        const TargetResidual here = target_residual(job, pupil, target, x, y);
        const Transverse e = transverse(here.outwards);
        const Dual u = component(e.first, here.residual), v = component(e.second, here.residual);
        const double det = u.x * v.y - u.y * v.x;
        const double dx = (u.y * v.v - v.y * u.v) / det, dy = (v.x * u.v - u.x * v.v) / det;
        const double size = std::sqrt(dx * dx + dy * dy), part = size > max_step ? max_step / size : 1.0;
        if (!std::isfinite(size)) break;
        x += part * dx, y += part * dy;
        converged = size <= tolerance && u.v * u.v + v.v * v.v < MAX_RESIDUAL * MAX_RESIDUAL;
    }
    job.converged[i] = converged;
    if (converged) job.xy[2 * i] = x, job.xy[2 * i + 1] = y;
}

void reflection_batch(const ShellReflectionJob& job, long first, int count) {
    for (long i = first; i < first + count; ++i) solve_one(job, i);
}

}  // namespace

void find_reflections_through_shell(const ShellReflectionJob& job) {
    in_batches(job, TARGETS_PER_TASK, reflection_batch);
}

}  // namespace omnimirror
