#include "covered.hpp"

#include "pieces.hpp"
#include "wall_optics.hpp"

namespace omnimirror {
namespace {

constexpr int TARGETS_A_PIECE = 512;
constexpr double ON_AXIS = 1e-24;  // mm^2, added to squared distances from the axis
constexpr double AIMED = 1e-3;     // larger residuals are not converged, however short the step (at a mirror's tip)

using Moving = Vector<Dual>;

Moving fixed(const double* row) { return {{row[0]}, {row[1]}, {row[2]}}; }

Moving turned(const double* by, Moving v) {
    return {by[0] * v.x + by[1] * v.y + by[2] * v.z, by[3] * v.x + by[4] * v.y + by[5] * v.z,
            by[6] * v.x + by[7] * v.y + by[8] * v.z};
}

struct Facet {
    Moving at, normal;  // towards the lens
};

// Mirror surface at (x, y) in its own frame, extrapolated quadratically beyond the table.
Facet facet(const CoveredJob& job, double x, double y) {
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
    const Moving at = turned(job.turn, {mx, my, {sag, slope * r.x, slope * r.y}});
    return {{at.x + job.shift[0], at.y + job.shift[1], at.z + job.shift[2]}, turned(job.turn, {over * sx, over * sy, -over})};
}

struct Arrival {
    Moving miss, outwards;
};

// Vector by which the ray via a mirror point misses its target.
Arrival arrival(const CoveredJob& job, const double* pupil, const double* target, double x, double y) {
    const Facet mirror = facet(job, x, y);
    const Moving from = job.distant_pupils ? fixed(pupil) : fixed(pupil) - mirror.at;
    const Moving to_pupil = (1 / length(from)) * from;
    const Moving reflected = 2 * dot(to_pupil, mirror.normal) * mirror.normal - to_pupil;
    WayOut<Dual> way = way_out(job.wall, mirror.at, reflected);
    const double height = way.met.z.v;
    if (job.wall.kind == WallKind::TUBE && job.wall.outside == 1.0 && !((height > job.ends[0]) & (height < job.ends[1])))
        way.left_at = mirror.at, way.outwards = reflected;
    if (job.distant_targets) return {way.outwards - fixed(target), way.outwards};
    const Moving rest = fixed(target) - way.left_at, whole = fixed(target) - mirror.at;
    const Dual over = 1 / length(whole);
    return {over * (dot(rest, way.outwards) * way.outwards - rest), way.outwards};
}

// Two unit vectors perpendicular to a third one and to each other (Duff et al., 2017).
struct Across {
    double first[3], second[3];
};

Across across(Moving to) {
    const double x = to.x.v, y = to.y.v, z = to.z.v, sign = std::copysign(1.0, z), a = -1 / (sign + z), b = x * y * a;
    return {{1 + sign * x * x * a, sign * b, -sign * x}, {b, sign + y * y * a, -y}};
}

Dual along(const double* e, Moving v) { return e[0] * v.x + e[1] * v.y + e[2] * v.z; }

void find_one(const CoveredJob& job, long i) {
    const double* const pupil = job.pupils + 3 * i;
    const double* const target = job.targets + 3 * i;
    double x = job.xy[2 * i], y = job.xy[2 * i + 1];
    const double longest = job.longest * job.rim, close = job.close * job.rim;
    bool settled = false;
    for (int step = 0; step < job.steps && !settled; ++step) {
        const Arrival here = arrival(job, pupil, target, x, y);
        const Across e = across(here.outwards);
        const Dual u = along(e.first, here.miss), v = along(e.second, here.miss);
        const double det = u.x * v.y - u.y * v.x;
        const double dx = (u.y * v.v - v.y * u.v) / det, dy = (v.x * u.v - u.x * v.v) / det;
        const double size = std::sqrt(dx * dx + dy * dy), part = size > longest ? longest / size : 1.0;
        if (!std::isfinite(size)) break;
        x += part * dx, y += part * dy;
        settled = size <= close && u.v * u.v + v.v * v.v < AIMED * AIMED;
    }
    job.settled[i] = settled;
    if (settled) job.xy[2 * i] = x, job.xy[2 * i + 1] = y;
}

void find_some(const CoveredJob& job, long first, int count) {
    for (long i = first; i < first + count; ++i) find_one(job, i);
}

}  // namespace

void find_covered(const CoveredJob& job) { in_pieces(job, TARGETS_A_PIECE, find_some); }

}  // namespace omnimirror
