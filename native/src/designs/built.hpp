// As-built designs: a tabulated lens with a moving pupil, and a transparent shell that refracts rays. Formulas:
// batch/closed_forms.py and tracing/meridian.py.
#pragma once

#include <cmath>
#include <initializer_list>
#include <limits>

#include "designs.hpp"

namespace omnimirror {
namespace {

// batch/closed_forms.py: cubic pieces over the tangent of the viewing angle.
class Lens {
public:
    explicit Lens(const LensTable& table) : table_(table), step_(table.end / table.cells) {}

    bool known() const { return table_.values != nullptr; }
    const LensTable& table() const { return table_; }

    // Interpolate the first `count` rows at a tangent.
    void at(double tangent, int count, double* rows) const {
        const double place = tangent / step_, last = table_.cells - 1;
        const int cell = static_cast<int>(place > 0 ? place < last ? place : last : 0.0);  // NaN: the first cell
        const double u = tangent / step_ - cell;
        const double* a = table_.values + static_cast<std::size_t>(cell) * 2 * LENS_ROWS;
        const double *da = a + LENS_ROWS, *b = da + LENS_ROWS, *db = b + LENS_ROWS;
        for (int r = 0; r < count; ++r) {
            const double bend = 3 * (b[r] - a[r]) - 2 * da[r] - db[r], twist = 2 * (a[r] - b[r]) + da[r] + db[r];
            rows[r] = a[r] + u * (da[r] + u * (bend + u * twist));
        }
    }

    // Return the tangent of the chief ray to a point at distance x from the axis and distance depth from the reference
    // point.
    double aimed(double x, double depth) const {
        double tangent = x / (depth - table_.pupil), rows[2];
        for (int i = 0; i < AIM_STEPS; ++i) {
            at(tangent, 2, rows);
            const double w = depth - rows[0];
            tangent -= (w * tangent - x) / (w - rows[1] * tangent);
        }
        return tangent;
    }

    double defocus(double v) const { return table_.f * v / (1 - (table_.f - table_.e) * v); }
    double defocus_rate(double v) const {
        const double c = 1 - (table_.f - table_.e) * v;
        return table_.f / (c * c);
    }

private:
    static constexpr int AIM_STEPS = 6;
    LensTable table_;
    double step_;
};

// Optics at a mirror point, as NodeOptics of batch/closed_forms.py.
struct Node {
    double omega, ray, magnification_t, magnification_s, vergence_t, vergence_s, viewpoint;
    bool seen, usable;
};

struct Pencil {
    double x, z, omega, spread, rate;
};

struct Refraction {
    double way, before_t, after_t, power_t, before_s, after_s, power_s;
};

// A ray refracted at one surface of a shell: tracing/meridian.py, _refracted.
inline Refraction refract(Pencil& ray, Wall::Kind kind, double radius, double height, double before, double after) {
    const double sin = std::sin(ray.omega), cos = std::cos(ray.omega);
    double way, normal, curvature_t = 0.0, curvature_s = 0.0;
    if (kind == Wall::PLANE) {
        way = (ray.z - height) / cos;
        normal = cos > 0 ? 0.0 : std::numeric_limits<double>::quiet_NaN();
    } else if (kind == Wall::CYLINDER) {
        way = (radius - ray.x) / sin;
        normal = 3.14159265358979323846 / 2;
        curvature_s = 1 / radius;
    } else {
        const double dz = ray.z - height, b = ray.x * sin - dz * cos, c = ray.x * ray.x + dz * dz - radius * radius;
        way = -b + std::sqrt(b * b - c);
        normal = std::atan2(ray.x + way * sin, way * cos - dz);
        curvature_t = curvature_s = 1 / radius;
    }
    const double i = ray.omega - normal, cos_i = std::cos(i), behind = std::asin(before / after * std::sin(i));
    const double cos_behind = std::cos(behind), gain = after * cos_behind - before * cos_i;
    const double along = (ray.spread + way * ray.rate) / cos_i, turn = curvature_t * along;
    const double rate = turn + before * cos_i * (ray.rate - turn) / (after * cos_behind);
    ray = {ray.x + way * sin, ray.z - way * cos, normal + behind, cos_behind * along, rate};
    return {way,
            before * cos_i * cos_i,
            after * cos_behind * cos_behind,
            gain * curvature_t,
            before,
            after,
            gain * curvature_s};
}

// 1/distance before a surface, from that behind it.
inline double before_side(double after, double power, double before, double way, double vergence) {
    const double v = (after * vergence - power) / before;
    return v / (1 - way * v);
}

// An object at 1/near, as imaged towards the mirror: its vergences; its movement across the ray with the mirror point,
// divided by its distance; and the difference of its distances from the mirror and from the reference point of the ray.
struct Object {
    double near_t, near_s, across, inside;
};

// Trace a ray out of the shell, to the point of its line nearest to its mirror point, and image the object towards the
// mirror; batch/closed_forms.py, _outside. Returns false if the ray does not leave the shell.
inline bool let_out(const Wall& wall, Pencil& ray, double near, Object& object, bool& seen) {
    object = {near, near, ray.rate + near * ray.spread, 0.0};
    seen = true;
    if (wall.kind == Wall::NONE) return true;
    const Pencil start = ray;
    if (wall.kind == Wall::CYLINDER) {
        const double height = start.z - (wall.inner_radius - start.x) / std::tan(start.omega);
        if (wall.medium_index != 1.0) {
            seen = height > wall.base;
            if (!seen) return true;
        } else if (!(height > wall.base && height < wall.cap)) {
            return true;
        }
    }
    const Refraction first = refract(ray, wall.kind, wall.inner_radius, wall.inner_height, 1.0, wall.index);
    const Refraction second =
        refract(ray, wall.kind, wall.outer_radius, wall.outer_height, wall.index, wall.medium_index);
    const double inside = first.way + second.way, behind = near / (1 - near * inside);
    double t = -behind, s = -behind;
    for (const Refraction* r : {&second, &first}) {
        t = before_side(r->after_t, r->power_t, r->before_t, r->way, t);
        s = before_side(r->after_s, r->power_s, r->before_s, r->way, s);
    }
    object = {-t, -s, (1 - near * inside) * ray.rate + near * ray.spread, inside};
    const bool apart = ray.rate > 0 && ray.spread > 0;  // neighbouring rays diverge where they leave the shell
    const double sin = std::sin(ray.omega), cos = std::cos(ray.omega);
    const double reach = (ray.x - start.x) * sin - (ray.z - start.z) * cos;
    ray = {ray.x - reach * sin, ray.z + reach * cos, ray.omega, ray.spread - reach * ray.rate, ray.rate};
    object.inside = inside - reach;
    return std::isfinite(ray.omega) && apart && wall.fits && near * inside < 1;
}

struct Aim {
    double w, tangent, drift;  // w is infinite for a telecentric lens
};

// batch/closed_forms.py, built_optics.
inline Node built_point(double x, double z, double slope, double curvature, double slope_over_x, double near, const Aim& aim,
                        bool telecentric, const Wall& wall) {
    const double t = aim.tangent, steep = 1 + slope * slope, root = std::sqrt(steep), cosine = 1 / std::sqrt(1 + t * t);
    const double cos_gamma = (1 - t * slope) * cosine / root;
    const double dtheta = telecentric ? 0.0 : (1 - t * slope) / (aim.w * (1 + t * t - aim.drift * t / aim.w));
    Pencil ray{x, z, 2 * std::atan(slope) + std::atan(t), cos_gamma * root, 2 * curvature / steep + dtheta};
    Object object;
    Node node;
    const bool passes = let_out(wall, ray, near, object, node.seen);
    const double q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + object.near_t);
    const double q_s = 1 / (2 * cos_gamma * slope_over_x / root + object.near_s);
    const double dray = telecentric ? 1.0 : dtheta * (1 + t * t), sine = std::sin(ray.omega);
    node.omega = ray.omega;
    node.ray = telecentric ? x : t;
    // distance of the object from the axis over its distance p: sin(Omega), plus x/p of the start of the ray
    const double around = sine + near * (ray.x - sine * object.inside);
    node.magnification_t = dray / object.across;
    node.magnification_s = x == 0 ? node.magnification_t : node.ray / around;
    node.vergence_t = telecentric ? -(z + q_t) : 1 / (aim.w + q_t * cosine);
    node.vergence_s = telecentric ? -(z + q_s) : 1 / (aim.w + q_s * cosine);
    node.viewpoint = ray.z + (x == 0 ? ray.spread / ray.rate : ray.x * std::cos(ray.omega) / sine);
    node.usable = !node.seen || (passes && ray.rate > 0 && cos_gamma > 0 && node.magnification_s > 0);
    return node;
}

}  // namespace
}  // namespace omnimirror
