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

    bool is_tabulated() const { return table_.values != nullptr; }
    const LensTable& table() const { return table_; }

    // Interpolate the first `count` rows at a tangent.
    void at(double tangent, int count, double* rows) const {
        const double position = tangent / step_, last = table_.cells - 1;
        const int cell =
            static_cast<int>(position > 0 ? position < last ? position : last : 0.0);  // NaN: the first cell
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
    double chief_ray_tangent(double x, double depth) const {
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
    bool visible, usable;
};

struct Pencil {
    double x, z, omega, spread, rate;
};

struct Refraction {
    double path_length, before_t, after_t, power_t, before_s, after_s, power_s;
};

// A ray refracted at one surface of a shell: tracing/meridian.py, _refracted.
inline Refraction refract(Pencil& ray, DesignShell::Kind kind, double radius, double height, double before,
                          double after) {
    const double sin = std::sin(ray.omega), cos = std::cos(ray.omega);
    double path_length, normal, curvature_t = 0.0, curvature_s = 0.0;
    if (kind == DesignShell::PLANE) {
        path_length = (ray.z - height) / cos;
        normal = cos > 0 ? 0.0 : std::numeric_limits<double>::quiet_NaN();
    } else if (kind == DesignShell::CYLINDER) {
        path_length = (radius - ray.x) / sin;
        normal = 3.14159265358979323846 / 2;
        curvature_s = 1 / radius;
    } else {
        const double dz = ray.z - height, b = ray.x * sin - dz * cos, c = ray.x * ray.x + dz * dz - radius * radius;
        path_length = -b + std::sqrt(b * b - c);
        normal = std::atan2(ray.x + path_length * sin, path_length * cos - dz);
        curvature_t = curvature_s = 1 / radius;
    }
    const double i = ray.omega - normal, cos_i = std::cos(i), behind = std::asin(before / after * std::sin(i));
    const double cos_behind = std::cos(behind), gain = after * cos_behind - before * cos_i;
    const double along = (ray.spread + path_length * ray.rate) / cos_i, turn = curvature_t * along;
    const double rate = turn + before * cos_i * (ray.rate - turn) / (after * cos_behind);
    ray = {ray.x + path_length * sin, ray.z - path_length * cos, normal + behind, cos_behind * along, rate};
    return {path_length, before * cos_i * cos_i, after * cos_behind * cos_behind, gain * curvature_t, before,
            after,       gain * curvature_s};
}

// 1/distance before a surface, from that behind it.
inline double before_side(double after, double power, double before, double path_length, double vergence) {
    const double v = (after * vergence - power) / before;
    return v / (1 - path_length * v);
}

// An object at 1/near, as imaged towards the mirror: its vergences; its movement across the ray with the mirror point,
// divided by its distance; and the difference of its distances from the mirror and from the reference point of the ray.
struct Object {
    double near_t, near_s, across, inside;
};

// Trace a ray out of the shell, to the point of its line nearest to its mirror point, and image the object towards the
// mirror; batch/closed_forms.py, _outside. Returns false if the ray does not leave the shell.
inline bool trace_shell(const DesignShell& shell, Pencil& ray, double inverse_distance, Object& object, bool& visible) {
    object = {inverse_distance, inverse_distance, ray.rate + inverse_distance * ray.spread, 0.0};
    visible = true;
    if (shell.kind == DesignShell::NONE) return true;
    const Pencil start = ray;
    if (shell.kind == DesignShell::CYLINDER) {
        const double height = start.z - (shell.inner_radius - start.x) / std::tan(start.omega);
        if (shell.medium_index != 1.0) {
            visible = height > shell.base;
            if (!visible) return true;
        } else if (!(height > shell.base && height < shell.cap)) {
            return true;
        }
    }
    const Refraction first = refract(ray, shell.kind, shell.inner_radius, shell.inner_height, 1.0, shell.index);
    const Refraction second =
        refract(ray, shell.kind, shell.outer_radius, shell.outer_height, shell.index, shell.medium_index);
    const double inside = first.path_length + second.path_length,
                 behind = inverse_distance / (1 - inverse_distance * inside);
    double t = -behind, s = -behind;
    for (const Refraction* r : {&second, &first}) {
        t = before_side(r->after_t, r->power_t, r->before_t, r->path_length, t);
        s = before_side(r->after_s, r->power_s, r->before_s, r->path_length, s);
    }
    object = {-t, -s, (1 - inverse_distance * inside) * ray.rate + inverse_distance * ray.spread, inside};
    const bool diverges = ray.rate > 0 && ray.spread > 0;  // neighbouring rays diverge where they leave the shell
    const double sin = std::sin(ray.omega), cos = std::cos(ray.omega);
    const double reach = (ray.x - start.x) * sin - (ray.z - start.z) * cos;
    ray = {ray.x - reach * sin, ray.z + reach * cos, ray.omega, ray.spread - reach * ray.rate, ray.rate};
    object.inside = inside - reach;
    return std::isfinite(ray.omega) && diverges && shell.fits && inverse_distance * inside < 1;
}

struct ChiefRay {
    double w, tangent, drift;  // w is infinite for a telecentric lens
};

// batch/closed_forms.py, built_optics.
inline Node real_point(double x, double z, double slope, double curvature, double slope_over_x, double inverse_distance,
                       const ChiefRay& chief_ray, bool telecentric, const DesignShell& shell) {
    const double t = chief_ray.tangent, steep = 1 + slope * slope, root = std::sqrt(steep),
                 cosine = 1 / std::sqrt(1 + t * t);
    const double cos_gamma = (1 - t * slope) * cosine / root;
    const double dtheta =
        telecentric ? 0.0 : (1 - t * slope) / (chief_ray.w * (1 + t * t - chief_ray.drift * t / chief_ray.w));
    Pencil ray{x, z, 2 * std::atan(slope) + std::atan(t), cos_gamma * root, 2 * curvature / steep + dtheta};
    Object object;
    Node node;
    const bool is_transmitted = trace_shell(shell, ray, inverse_distance, object, node.visible);
    const double q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + object.near_t);
    const double q_s = 1 / (2 * cos_gamma * slope_over_x / root + object.near_s);
    const double dray = telecentric ? 1.0 : dtheta * (1 + t * t), sine = std::sin(ray.omega);
    node.omega = ray.omega;
    node.ray = telecentric ? x : t;
    // distance of the object from the axis over its distance p: sin(Omega), plus x/p of the start of the ray
    const double azimuthal = sine + inverse_distance * (ray.x - sine * object.inside);
    node.magnification_t = dray / object.across;
    node.magnification_s = x == 0 ? node.magnification_t : node.ray / azimuthal;
    node.vergence_t = telecentric ? -(z + q_t) : 1 / (chief_ray.w + q_t * cosine);
    node.vergence_s = telecentric ? -(z + q_s) : 1 / (chief_ray.w + q_s * cosine);
    node.viewpoint = ray.z + (x == 0 ? ray.spread / ray.rate : ray.x * std::cos(ray.omega) / sine);
    node.usable = !node.visible || (is_transmitted && ray.rate > 0 && cos_gamma > 0 && node.magnification_s > 0);
    return node;
}

}  // namespace
}  // namespace omnimirror
