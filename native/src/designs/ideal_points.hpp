// Optics at the mirror points of one design with an ideal lens: batch/closed_forms.py.
#pragma once

#include "workspace.hpp"

namespace omnimirror {
namespace {

// z/M, z' and M z'' of z/M = sum c_k B_k(x/M), and of a conic with vertex curvature c and conic constant k: z = c x^2 /
// (1 + w), z' = c x / w, z'' = c / w^3, w^2 = 1 - (1 + k) (c x)^2.
template <bool CONIC>
void fill_profile(const DesignJob& job, int design, const Workspace& w) {
    const double* c = job.coefficients + static_cast<std::size_t>(design) * job.terms;
    const double* number = job.numbers + static_cast<std::size_t>(design) * DESIGN_NUMBERS;
    const double vertex = number[1] / number[4], form = (1 + number[5]) * vertex * vertex;
    for (int k = 0; k < w.lanes; k += LANE) {
        double z[LANE] = {}, slope[LANE] = {}, curvature[LANE] = {};
        if constexpr (CONIC) {
            OMNIMIRROR_LANES(i, k) {
                const double x = w.fractions[i], root = sqrt_of(1 - form * (x * x)), inverse = 1 / root;
                z[i - k] = vertex * (x * x) / (1 + root);
                slope[i - k] = vertex * x * inverse;
                curvature[i - k] = vertex * (inverse * inverse * inverse);
            }
        }
        for (int t = 0; t < job.terms; ++t) {
            const int row = t * w.lanes;
            OMNIMIRROR_LANES(i, k) {
                z[i - k] += c[t] * w.sag[row + i];
                slope[i - k] += c[t] * w.slope_basis[row + i];
                curvature[i - k] += c[t] * w.curvature_basis[row + i];
            }
        }
        OMNIMIRROR_LANES(i, k) { w.z[i] = z[i - k], w.slope[i] = slope[i - k], w.curvature[i] = curvature[i - k]; }
    }
}

// arctan, accurate to the last digit but one for all numbers: a rational approximation (S. Moshier, Cephes) of the
// difference from 0, 45 or 90 deg. Branch-free, so that compilers vectorise it.
inline double arctangent(double x) {
    constexpr double QUARTER = 0.78539816339744830962, REST = 3.061616997868382943e-17;  // pi / 4, and rounding error
    const double a = abs_of(x);
    const bool is_steep = a > 2.41421356237309504880, is_middle = a > 0.66;
    const double above = is_steep ? -1.0 : is_middle ? a - 1 : a, below = is_steep ? a : is_middle ? a + 1 : 1.0;
    const double part = is_steep ? 2.0 : is_middle ? 1.0 : 0.0, t = above / below, s = t * t;
    const double p =
        (((-8.750608600031904122785e-1 * s - 1.615753718733365076637e1) * s - 7.500855792314704667340e1) * s -
         1.228866684490136173410e2) *
            s -
        6.485021904942025371773e1;
    const double q =
        ((((s + 2.485846490142306297962e1) * s + 1.650270098316988542046e2) * s + 4.328810604912902668951e2) * s +
         4.853903996359136964868e2) *
            s +
        1.945506571482613964425e2;
    const double angle = part * QUARTER + (t + (t * s * (p / q) + part * REST));
    return x < 0 ? -angle : angle;
}

// With w = m + z, rho^2 = w^2 + x^2, g = w - x z', e = 1 + z'^2, s = 2 w z'/x + 1 - z'^2, p = 1/distance of the object:
//   M_t = g e rho^2 / (w^2 d), d = 2 z'' rho^2 + g e = e rho^2 dOmega/dx (Eq. 8), M_s = rho e / (w s) (Eqs. 9, 10), of
//   an object at 1/p with d + p g e rho and s + p e rho in the place of d and s, v_t = rho a / (w (rho a + g e)), a = 2
//   z'' rho + p g e, v_s = b / (w (b + e)), b = 2 g z'/x + p e rho (Eqs. 34, 35).
struct Perspective {
    static constexpr bool IS_TELECENTRIC = false;
    double m;
};

// The limit m -> infinity: dOmega/dx = 2 z''/e, M_t = e / (2 z''), M_s = e x / (2 z'), v = -(z + q).
struct Telecentric {
    static constexpr bool IS_TELECENTRIC = true;
};

struct Point {
    double ray, magnification_t, magnification_s, inverse_magnification, vergence_t, vergence_s, viewpoint;
    bool is_usable;
};

inline Point point_of(const Perspective& lens, double x, double z, double slope, double curvature, double over_x,
                      double inverse_distance) {
    const double w = lens.m + z, steep = 1 + slope * slope, to_lens = w * w + x * x, rho = sqrt_of(to_lens);
    const double front = w - x * slope, ge = front * steep, back = 1 - slope * slope;
    const double sine = 2 * w * over_x + back, turn = 2 * curvature * to_lens + ge;
    const double a = rho * (2 * curvature * rho + inverse_distance * ge), far = steep * rho,
                 b = 2 * front * over_x + inverse_distance * far;
    const double inverse = 1 / (w * sine), seen_t = ge * to_lens, seen_s = far / (w * (sine + inverse_distance * far));
    const double turn_near = turn + inverse_distance * ge * rho;
    return {x / w,
            seen_t / (w * w * turn_near),
            seen_s,
            w * w * turn_near / (seen_t * seen_s),
            a / (w * (a + ge)),
            b / (w * (b + steep)),
            z + (w * back - 2 * slope * x) * (w * inverse),
            turn > 0 && front > 0 && seen_s > 0};
}

inline Point point_of(const Telecentric&, double x, double z, double slope, double curvature, double over_x,
                      double inverse_distance) {
    const double steep = 1 + slope * slope, double_t = 2 * curvature, double_s = 2 * over_x, inverse = 1 / double_s;
    const double near_t = double_t + inverse_distance * steep, near_s = double_s + inverse_distance * steep;
    return {x,
            steep / near_t,
            steep / near_s,
            near_t * near_s / (steep * steep),
            -(z + steep / near_t),
            -(z + steep / near_s),
            z + (1 - slope * slope) * inverse,
            double_t > 0 && over_x > 0};
}

// Compute all values that do not depend on the focus; return whether the design is valid.
template <class Lens>
bool fill_points(const Lens& lens, double M, double min_omega, const Workspace& w) {
    const double inverse_M = 1 / M;
    double usable[LANE];
    for (double& u : usable) u = 1.0;
    double *OMNIMIRROR_RESTRICT omegas = w.column(OMEGA), *OMNIMIRROR_RESTRICT viewpoints = w.column(VIEWPOINT);
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const double u = w.fractions[i], x = u * M, slope = w.slope[i], curvature = w.curvature[i] * inverse_M;
            const double over_x = u > 0 ? slope * w.inverse_fractions[i] * inverse_M : curvature;
            const Point p = point_of(lens, x, w.z[i] * M, slope, curvature, over_x, w.inverse_distance[i]);
            const double omega = 2 * arctangent(slope) + (Lens::IS_TELECENTRIC ? 0.0 : arctangent(p.ray));
            w.ray[i] = p.ray;
            w.magnification_t[i] = p.magnification_t, w.magnification_s[i] = p.magnification_s;
            w.vergence_t[i] = p.vergence_t, w.vergence_s[i] = p.vergence_s;
            w.inverse_magnification[i] = p.inverse_magnification;
            w.density[i] = omega < min_omega ? 0.0 : p.inverse_magnification * p.inverse_magnification;
            omegas[i] = omega, viewpoints[i] = p.viewpoint;
            usable[i - k] = p.is_usable ? usable[i - k] : 0.0;
        }
    }
    double all = 1.0;
    for (double u : usable) all *= u;
    return all > 0;
}

}  // namespace
}  // namespace omnimirror
