// Kernel of reflection.hpp. Compiled once per instruction set; therefore, everything has internal linkage.
//
// Rays are processed in blocks: each step is a branch-free loop over a block, which compilers vectorise, and a block
// ends when all of its rays have converged.
#pragma once

#include "lanes.hpp"
#include "reflection.hpp"

namespace omnimirror {
namespace {

constexpr int BLOCK = 64;
constexpr double ON_AXIS = 1e-24;  // mm^2, added to squared distances from the axis
constexpr double PI = 3.14159265358979323846;

#define OMNIMIRROR_BLOCK(i)            \
    for (int k = 0; k < BLOCK; k += LANE) \
    OMNIMIRROR_LANES(i, k)

struct Lanes {
    double at[BLOCK];
    double& operator[](int i) { return at[i]; }
    double operator[](int i) const { return at[i]; }
    double maximum() const {
        double parts[LANE] = {};
        OMNIMIRROR_BLOCK(i) parts[i - k] = max_of(at[i], parts[i - k]);
        double maximum = parts[0];
        for (double part : parts) maximum = max_of(maximum, part);
        return maximum;
    }
};

// arctan(y / x) for y >= 0, from 0 to pi, with an error of 1e-5: for initial values only.
inline double approximate_angle(double y, double x) {
    const double across = abs_of(x), low = min_of(y, across), high = max_of(y, across);
    const double t = low / max_of(high, 1e-300), s = t * t;
    const double p = 0.99997726 + s * (-0.33262347 + s * (0.19354346 + s * (-0.11643287 + s * (0.05265332 - 0.01172120 * s))));
    const double inner = t * p, first = y > across ? PI / 2 - inner : inner;
    return x < 0 ? PI - first : first;
}

inline double clamped(double x, double low, double high) { return min_of(max_of(x, low), high); }

struct Cubic {
    double value, rate;
};

// Coefficient at this index; addressed by table and index, which compilers convert to gathers.
inline Cubic cubic(const double* table, int at, double t) {
    const double b = table[at + 1], c = table[at + 2], d = table[at + 3];
    return {table[at] + t * (b + t * (c + t * d)), b + t * (2 * c + t * (3 * d))};
}

struct Curve {
    const double* pieces;
    double last;

    explicit Curve(const CubicPieces& table) : pieces(table.coefficients), last(table.pieces - 1.0) {}

    double at(double position) const {
        const int piece = static_cast<int>(clamped(position, 0.0, last));
        return cubic(pieces, 4 * piece, position - piece).value;
    }
};

struct Meridian {
    double sag, slope, bend;
};

struct Profile {
    const double* pieces;
    double last, per_mm;

    explicit Profile(const ReflectionSurface& s)
        : pieces(s.meridian.coefficients), last(s.meridian.pieces - 1.0), per_mm(1 / s.cell) {}

    Meridian at(double r) const {
        const double position = r * per_mm;
        const int piece = static_cast<int>(clamped(position, 0.0, last));
        const double t = position - piece;
        const Cubic slope = cubic(pieces, 8 * piece + 4, t);
        return {cubic(pieces, 8 * piece, t).value, slope.value, slope.rate * per_mm};
    }
};

// Unit vector from an end to a point, and the inverse of the distance.
struct UnitVector {
    double x, y, z, inverse_distance;
};

template <bool DISTANT>
inline UnitVector unit_vector(double x, double y, double z, double ex, double ey, double ez) {
    if constexpr (DISTANT) return {-ex, -ey, -ez, 0.0};
    const double dx = x - ex, dy = y - ey, dz = z - ez;
    const double inverse_distance = 1 / sqrt_of(dx * dx + dy * dy + dz * dz);
    return {dx * inverse_distance, dy * inverse_distance, dz * inverse_distance, inverse_distance};
}

struct Block {
    Lanes x, y, z, sx, sy, a, b, c, size;
};

// Distances from the axis in the meridian of each target.
template <bool TELECENTRIC, bool DISTANT>
void meridian_initial_values(const ReflectionJob& job, const Lanes* target, Block& block) {
    const ReflectionSurface& s = job.surface;
    const Profile profile(s);
    const Curve by_omega(job.by_omega);
    const double first_omega = job.omegas[0], angles = job.by_omega.pieces, min_radius = s.min_radius;
    const double breadth = job.omegas[1] - job.omegas[0], per_omega = breadth > 0 ? angles / breadth : 0.0;  // a cone: 0
    const double middle = DISTANT ? 0.0 : job.middle;
    const double max_step = job.search.max_step * s.rim, max_radius = job.search.max_radius * s.rim, pupil = s.pupil[2];
    Lanes across, r;
    OMNIMIRROR_BLOCK(i) {
        across[i] = sqrt_of(target[0][i] * target[0][i] + target[1][i] * target[1][i] + ON_AXIS);
        const double omega = approximate_angle(across[i], middle - target[2][i]);
        r[i] = by_omega.at(clamped((omega - first_omega) * per_omega, 0.0, angles));
    }
    for (int step = 0; step < job.search.first_steps; ++step) {
        OMNIMIRROR_BLOCK(i) {
            const Meridian m = profile.at(r[i]);
            const UnitVector p = unit_vector<TELECENTRIC>(r[i], 0.0, m.sag, 0.0, 0.0, pupil);
            const UnitVector t = unit_vector<DISTANT>(r[i], 0.0, m.sag, across[i], 0.0, target[2][i]);
            const double by_p = p.x + m.slope * p.z, by_t = t.x + m.slope * t.z, steep = 1 + m.slope * m.slope;
            const double bend = (steep - by_p * by_p) * p.inverse_distance +
                                (steep - by_t * by_t) * t.inverse_distance + (p.z + t.z) * m.bend;
            const double move = clamped((by_p + by_t) / bend, -max_step, max_step);
            r[i] = clamped(r[i] - move, min_radius, max_radius);
            block.size[i] = abs_of(move);
        }
        if (!(block.size.maximum() > job.search.first_tolerance * s.rim)) break;
    }
    OMNIMIRROR_BLOCK(i) {
        const double share = max_of(r[i], min_radius) / across[i];
        block.x[i] = share * target[0][i], block.y[i] = share * target[1][i];
    }
}

// Shorten steps that are too long, and clamp points that would leave the surface to its end: rare, so in a separate
// loop.
inline void limit_step(Block& block, const Lanes& x, const Lanes& y, double max_step, double max_radius) {
    OMNIMIRROR_BLOCK(i) {
        const double size = sqrt_of(block.size[i]), part = size > max_step ? max_step / size : 1.0;
        const double nx = x[i] + part * (block.x[i] - x[i]), ny = y[i] + part * (block.y[i] - y[i]);
        const double out = sqrt_of(nx * nx + ny * ny + ON_AXIS), back = out > max_radius ? max_radius / out : 1.0;
        block.x[i] = nx * back, block.y[i] = ny * back;
    }
}

// One Newton step for all lanes; sizes are squared step lengths.
template <bool TELECENTRIC, bool DISTANT>
void newton_step(const ReflectionJob& job, const Lanes* target, Block& block) {
    const ReflectionSurface& s = job.surface;
    const Profile profile(s);
    const double max_step = job.search.max_step * s.rim, max_radius = job.search.max_radius * s.rim;
    const double px = s.pupil[0], py = s.pupil[1], pz = s.pupil[2];
    const Lanes before_x = block.x, before_y = block.y;
    Lanes far;
    OMNIMIRROR_BLOCK(i) {
        const double x = block.x[i], y = block.y[i], r = sqrt_of(x * x + y * y + ON_AXIS), over = 1 / r;
        const Meridian m = profile.at(r);
        const double hoop = m.slope * over, cos = x * over, sin = y * over, sx = m.slope * cos, sy = m.slope * sin;
        const double across = (m.bend - hoop) * cos, along = (m.bend - hoop) * sin;
        const UnitVector p = unit_vector<TELECENTRIC>(x, y, m.sag, px, py, pz);
        const UnitVector t = unit_vector<DISTANT>(x, y, m.sag, target[0][i], target[1][i], target[2][i]);
        const double ux = p.x + sx * p.z, uy = p.y + sy * p.z, vx = t.x + sx * t.z, vy = t.y + sy * t.z, gz = p.z + t.z;
        const double gx = ux + vx, gy = uy + vy;
        const double a = (1 + sx * sx - ux * ux) * p.inverse_distance + (1 + sx * sx - vx * vx) * t.inverse_distance +
                         gz * (hoop + across * cos);
        const double b =
            (sx * sy - ux * uy) * p.inverse_distance + (sx * sy - vx * vy) * t.inverse_distance + gz * across * sin;
        const double c = (1 + sy * sy - uy * uy) * p.inverse_distance + (1 + sy * sy - vy * vy) * t.inverse_distance +
                         gz * (hoop + along * sin);
        const double det = 1 / (a * c - b * b), ia = c * det, ib = -b * det, ic = a * det;
        const double dx = ia * gx + ib * gy, dy = ib * gx + ic * gy, nx = x - dx, ny = y - dy;
        block.x[i] = nx, block.y[i] = ny, block.size[i] = dx * dx + dy * dy;
        far[i] = nx * nx + ny * ny;
        block.a[i] = ia, block.b[i] = ib, block.c[i] = ic;
    }
    if (!(block.size.maximum() <= max_step * max_step) | !(far.maximum() <= max_radius * max_radius))
        limit_step(block, before_x, before_y, max_step, max_radius);
}

template <bool TELECENTRIC, bool DISTANT>
void reflection_block(const ReflectionJob& job, long first, int count) {
    const ReflectionSurface& s = job.surface;
    const Profile profile(s);
    Lanes target[3];
    for (int axis = 0; axis < 3; ++axis)  // the last target is repeated in the remaining lanes
        for (int i = 0; i < BLOCK; ++i) target[axis][i] = job.targets[axis][first + (i < count ? i : count - 1)];
    Block block;
    meridian_initial_values<TELECENTRIC, DISTANT>(job, target, block);
    const double rim = s.rim * (1 + job.search.rim_slack), tolerance = job.search.tolerance * s.rim;
    for (int step = 0; step < job.search.steps; ++step) {
        newton_step<TELECENTRIC, DISTANT>(job, target, block);
        if (!(block.size.maximum() > tolerance * tolerance)) break;
    }
    const double px = s.pupil[0], py = s.pupil[1], pz = s.pupil[2];
    Lanes state;
    OMNIMIRROR_BLOCK(i) {
        const double x = block.x[i], y = block.y[i];
        const double r = sqrt_of(x * x + y * y + ON_AXIS);
        const Meridian m = profile.at(r);
        const double tilt = m.slope / r;
        block.z[i] = m.sag;
        const UnitVector p = unit_vector<TELECENTRIC>(x, y, m.sag, px, py, pz);
        const UnitVector t = unit_vector<DISTANT>(x, y, m.sag, target[0][i], target[1][i], target[2][i]);
        const double sx = tilt * x, sy = tilt * y;
        const double facing = min_of(p.z - sx * p.x - sy * p.y, t.z - sx * t.x - sy * t.y);
        const double visible = ((facing > 0) & (x * x + y * y <= rim * rim)) ? 1.0 : 0.0;
        block.sx[i] = sx, block.sy[i] = sy;
        state[i] = block.size[i] <= tolerance * tolerance ? visible : 2.0;  // 2 also for NaN
    }
    const Lanes* const rows[REFLECTION_ROWS] = {&block.x,  &block.y, &block.z, &block.sx,
                                                &block.sy, &block.a, &block.b, &block.c};
    for (int row = 0; row < REFLECTION_ROWS; ++row)
        for (int i = 0; i < count; ++i) job.rows[row][first + i] = (*rows[row])[i];
    for (int i = 0; i < count; ++i) job.states[first + i] = static_cast<std::uint8_t>(state[i]);
}

void intersection_block(const IntersectionJob& job, long first, int count) {
    const ReflectionSurface& s = job.surface;
    const Profile profile(s);
    Lanes direction[3], t, size, closing_rate, x, y, z, sx, sy, state;
    for (int axis = 0; axis < 3; ++axis)
        for (int i = 0; i < BLOCK; ++i) direction[axis][i] = job.directions[axis][first + (i < count ? i : count - 1)];
    const Curve depth(job.depth);
    const double tangents = job.depth.pieces, per_tangent = tangents / job.max_tangent;
    const double px = s.pupil[0], py = s.pupil[1], pz = s.pupil[2];
    OMNIMIRROR_BLOCK(i) {
        const double tangent =
            sqrt_of(direction[0][i] * direction[0][i] + direction[1][i] * direction[1][i]) / direction[2][i];
        t[i] = depth.at(clamped(tangent * per_tangent, 0.0, tangents)) / direction[2][i];
    }
    for (int step = 0; step < job.search.steps; ++step) {
        OMNIMIRROR_BLOCK(i) {
            x[i] = px + t[i] * direction[0][i], y[i] = py + t[i] * direction[1][i], z[i] = pz + t[i] * direction[2][i];
            const double r = sqrt_of(x[i] * x[i] + y[i] * y[i] + ON_AXIS);
            const Meridian m = profile.at(r);
            const double tilt = m.slope / r;
            sx[i] = tilt * x[i], sy[i] = tilt * y[i];
            closing_rate[i] = direction[2][i] - sx[i] * direction[0][i] - sy[i] * direction[1][i];
            const double move = (z[i] - m.sag) / closing_rate[i];
            t[i] -= move, size[i] = abs_of(move);
        }
        if (!(size.maximum() > job.search.tolerance * s.rim)) break;
    }
    const double rim = s.rim * (1 + job.search.rim_slack), tolerance = job.search.tolerance * s.rim;
    OMNIMIRROR_BLOCK(i) {
        x[i] = px + t[i] * direction[0][i], y[i] = py + t[i] * direction[1][i], z[i] = pz + t[i] * direction[2][i];
        const double ahead = min_of(closing_rate[i], t[i]), square = x[i] * x[i] + y[i] * y[i];
        state[i] = ((size[i] <= tolerance) & (ahead > 0) & (square <= rim * rim)) ? 1.0 : 0.0;
    }
    const Lanes* const rows[INTERSECTION_ROWS] = {&x, &y, &z, &sx, &sy, &t};
    for (int row = 0; row < INTERSECTION_ROWS; ++row)
        for (int i = 0; i < count; ++i) job.rows[row][first + i] = (*rows[row])[i];
    for (int i = 0; i < count; ++i) job.states[first + i] = static_cast<std::uint8_t>(state[i]);
}

void reflection_batch(const ReflectionJob& job, long first, int count) {
    using Find = void (*)(const ReflectionJob&, long, int);
    constexpr Find finds[2][2] = {{reflection_block<false, false>, reflection_block<false, true>},
                                  {reflection_block<true, false>, reflection_block<true, true>}};
    const Find find = finds[job.surface.telecentric][job.distant];
    for (int at = 0; at < count; at += BLOCK) find(job, first + at, count - at < BLOCK ? count - at : BLOCK);
}

void intersection_batch(const IntersectionJob& job, long first, int count) {
    for (int at = 0; at < count; at += BLOCK)
        intersection_block(job, first + at, count - at < BLOCK ? count - at : BLOCK);
}

}  // namespace
}  // namespace omnimirror
