// Kernel of trials.hpp. Compiled once per instruction set; therefore, everything has internal linkage.
//
// ObjectArguments are processed in lanes: each step is a branch-free loop over all of them, which compilers vectorise.
#pragma once

#include <cstddef>
#include <iterator>
#include <limits>
#include <vector>

#include "mirror_surface.hpp"

namespace omnimirror {
namespace {

struct Sum {
    double part[LANE] = {};
    double total() const {
        double sum = 0;
        for (double p : part) sum += p;
        return sum;
    }
    double maximum() const {
        double maximum = part[0];
        for (double p : part) maximum = max_of(maximum, p);
        return maximum;
    }
};

// Working arrays of lanes, reused for one trial after the other, and data shared by all trials.
struct Workspace {
    int lanes;
    std::vector<double> memory;
    double *tx, *ty, *tz;                 // targets in the mirror frame
    double *x, *y;                        // mirror points
    double *px, *py;                      // tangents
    double *v00, *v01, *v10, *v11;        // vergences in image right and down
    double *s0, *s1, *s2, *d0, *d1, *d2;  // squares and determinants of the blur, by powers of vergence
    double *u, *v;                        // offsets, px
    double *startx, *starty, *refx, *refy, *j00, *j01, *j10, *j11, *area, *weight;
    double* residual;      // residual: x of all, then y
    double* compensators;  // of compensators: affine, basis, radial

    explicit Workspace(const TrialJob& job) : lanes(padded(job.field.count)) {
        const auto& c = job.compensators;
        const int all = c.affine_rows + c.basis_rows + c.radial_rows;
        double** const arrays[] = {&tx, &ty, &tz, &x,  &y,  &px, &py, &v00, &v01, &v10, &v11, &s0, &s1, &s2, &d0, &d1,
                                   &d2, &u,  &v,  &startx, &starty, &refx, &refy, &j00, &j01, &j10, &j11, &area, &weight};
        memory.assign(static_cast<std::size_t>(lanes) * (std::size(arrays) + 2 + 2 * static_cast<std::size_t>(all)), 0.0);
        double* at = memory.data();
        for (double** array : arrays) *array = at, at += lanes;
        residual = at, at += 2 * lanes;
        compensators = at;
        fill(job.field);
        copy(c.affine, c.affine_rows, job.field.count, at);
        copy(c.basis, c.basis_rows, job.field.count, at);
        copy(c.radial, c.radial_rows, job.field.count, at);
    }

   private:
    // Padding lanes repeat the last object, with weight 0.
    void fill(const TrialField& f) {
        for (int i = 0; i < lanes; ++i) {
            const int k = i < f.count ? i : f.count - 1;
            startx[i] = f.start[2 * k], starty[i] = f.start[2 * k + 1];
            refx[i] = f.reference[2 * k], refy[i] = f.reference[2 * k + 1];
            const double* j = f.deg_per_px + 4 * k;
            j00[i] = j[0], j01[i] = j[1], j10[i] = j[2], j11[i] = j[3];
            area[i] = f.area[k], weight[i] = i < f.count;
        }
    }
    void copy(const double* from, int count, int n, double*& at) {
        for (int r = 0; r < count; ++r, at += 2 * lanes)
            for (int half = 0; half < 2; ++half)
                for (int i = 0; i < n; ++i) at[half * lanes + i] = from[(2 * r + half) * n + i];
    }
};

// -- ray tracing: trial_images.py --------------------------------------------------------------------

// Optical path length via a mirror point, and its derivatives with respect to (x, y).
struct Path {
    double dx, dy, dz;     // from the pupil to the mirror
    double gx, gy;         // gradient
    double a, b, c;        // H
    double ba, bb, bc;     // B: without the contribution of the pupil
    double sx, sy;         // slopes of the surface
    double facing;
};

template <bool DISTANT, class S>
inline Path path_at(const S& surface, const double* pupil, double tx, double ty, double tz, double x, double y) {
    const Heights h = surface.at(x, y);
    const double dx = x - pupil[0], dy = y - pupil[1], dz = h.z - pupil[2];
    const double near = 1 / sqrt_of(dx * dx + dy * dy + dz * dz);
    const double uz = dz * near, ux = dx * near + h.gx * uz, uy = dy * near + h.gy * uz;
    const double pa = (1 + h.gx * h.gx - ux * ux) * near, pb = (h.gx * h.gy - ux * uy) * near,
                 pc = (1 + h.gy * h.gy - uy * uy) * near;
    double far = 0, ex = -tx, ey = -ty, ez = -tz;
    if constexpr (!DISTANT) {
        ex = x - tx, ey = y - ty, ez = h.z - tz;
        far = 1 / sqrt_of(ex * ex + ey * ey + ez * ez);
        ex *= far, ey *= far, ez *= far;
    }
    const double qx = ex + h.gx * ez, qy = ey + h.gy * ez, pull = uz + ez;
    double ba = pull * h.hxx, bb = pull * h.hxy, bc = pull * h.hyy;
    if constexpr (!DISTANT) {
        ba += (1 + h.gx * h.gx - qx * qx) * far;
        bb += (h.gx * h.gy - qx * qy) * far;
        bc += (1 + h.gy * h.gy - qy * qy) * far;
    }
    return {dx, dy, dz, ux + qx, uy + qy, ba + pa, bb + pb, bc + pc, ba, bb, bc, h.gx, h.gy, pull};
}

// Targets in the mirror frame.
inline void rotate_targets(const TrialJob& job, const double* number, Workspace& w) {
    const double *r = number + ROTATION, *shift = number + SHIFT;
    for (int i = 0; i < w.lanes; ++i) {
        const int k = i < job.field.count ? i : job.field.count - 1;
        const double* t = job.field.targets + 3 * k;
        const double move = job.field.distant ? 0.0 : 1.0;
        const double x = t[0] - move * shift[0], y = t[1] - move * shift[1], z = t[2] - move * shift[2];
        w.tx[i] = r[0] * x + r[3] * y + r[6] * z;
        w.ty[i] = r[1] * x + r[4] * y + r[7] * z;
        w.tz[i] = r[2] * x + r[5] * y + r[8] * z;
    }
}

template <bool DISTANT, class S>
void find_mirror_points(const TrialJob& job, const S& surface, const double* number, Workspace& w) {
    const double pupil[3] = {number[PUPIL], number[PUPIL + 1], number[PUPIL + 2]};
    double *OMNIMIRROR_RESTRICT x = w.x, *OMNIMIRROR_RESTRICT y = w.y;
    const double *tx = w.tx, *ty = w.ty, *tz = w.tz;
    for (int i = 0; i < w.lanes; ++i) x[i] = w.startx[i], y[i] = w.starty[i];
    for (int step = 0; step < job.search.steps; ++step) {
        Sum max_step;
        for (int k = 0; k < w.lanes; k += LANE) {
            OMNIMIRROR_LANES(i, k) {
                const Path p = path_at<DISTANT>(surface, pupil, tx[i], ty[i], tz[i], x[i], y[i]);
                const double over = 1 / (p.a * p.c - p.b * p.b);
                const double mx = (p.c * p.gx - p.b * p.gy) * over, my = (p.a * p.gy - p.b * p.gx) * over;
                x[i] -= mx, y[i] -= my;
                max_step.part[i - k] = max_of(max_of(abs_of(mx), abs_of(my)), max_step.part[i - k]);
            }
        }
        if (!(max_step.maximum() > job.search.tolerance * job.rim)) break;
    }
}

// Compute tangents and vergences at the mirror points; return the number of lost rays.
template <bool DISTANT, class S>
int trace_rays(const TrialJob& job, const S& surface, const double* number, Workspace& w) {
    const double pupil[3] = {number[PUPIL], number[PUPIL + 1], number[PUPIL + 2]};
    const double* r = number + ROTATION;
    const double rim = job.rim * (1 + job.search.rim_slack), reflection_tolerance = job.search.reflection_tolerance;
    Sum valid_count;
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const double x = w.x[i], y = w.y[i];
            const Path p = path_at<DISTANT>(surface, pupil, w.tx[i], w.ty[i], w.tz[i], x, y);
            const double over_z = 1 / (r[6] * p.dx + r[7] * p.dy + r[8] * p.dz);
            const double px = (r[0] * p.dx + r[1] * p.dy + r[2] * p.dz) * over_z;
            const double py = (r[3] * p.dx + r[4] * p.dy + r[5] * p.dz) * over_z;
            const double m0z = r[6] + r[8] * p.sx, m1z = r[7] + r[8] * p.sy;
            const double s00 = r[0] + r[2] * p.sx - px * m0z, s01 = r[1] + r[2] * p.sy - px * m1z;
            const double s10 = r[3] + r[5] * p.sx - py * m0z, s11 = r[4] + r[5] * p.sy - py * m1z;
            const double over = over_z / (p.a * p.c - p.b * p.b);  // H^-1 B / z
            const double q00 = (p.c * p.ba - p.b * p.bb) * over, q01 = (p.c * p.bb - p.b * p.bc) * over;
            const double q10 = (p.a * p.bb - p.b * p.ba) * over, q11 = (p.a * p.bc - p.b * p.bb) * over;
            const double a00 = s00 * q00 + s01 * q10, a01 = s00 * q01 + s01 * q11;  // S V S^-1; the factor 1/z cancels
            const double a10 = s10 * q00 + s11 * q10, a11 = s10 * q01 + s11 * q11;
            const double turn = 1 / (s00 * s11 - s01 * s10);
            w.v00[i] = (a00 * s11 - a01 * s10) * turn, w.v01[i] = (a01 * s00 - a00 * s01) * turn;
            w.v10[i] = (a10 * s11 - a11 * s10) * turn, w.v11[i] = (a11 * s00 - a10 * s01) * turn;
            w.px[i] = px, w.py[i] = py;
            const double miss = p.gx * p.gx + p.gy * p.gy, upright = 1 + p.sx * p.sx + p.sy * p.sy;
            const bool reflected = miss <= reflection_tolerance * reflection_tolerance * upright;
            const bool within = x * x + y * y <= rim * rim;
            valid_count.part[i - k] += (reflected & within & (p.facing > 0) & (over_z > 0)) ? w.weight[i] : 0.0;
        }
    }
    return job.field.count - static_cast<int>(valid_count.total());
}

// -- images and blur: trial_images.py ----------------------------------------------------------------

// Offsets in px, and their derivatives with respect to the tangents.
struct ImagePoint {
    double u, v, w00, w01, w10, w11, over;
};

inline ImagePoint image_point(const double* number, double magnification, double x, double y) {
    const double *k = number + BROWN, *h = number + IMAGER;
    const double s = x * x + y * y, radial = 1 + s * (k[0] + s * (k[1] + s * k[2]));
    const double rate = 2 * (k[0] + s * (2 * k[1] + 3 * s * k[2])), p1 = k[3], p2 = k[4];
    const double mx = magnification * (x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x));
    const double my = magnification * (y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y);
    const double xx = magnification * (radial + x * x * rate + 2 * p1 * y + 6 * p2 * x);
    const double xy = magnification * (x * y * rate + 2 * p1 * x + 2 * p2 * y);
    const double yy = magnification * (radial + y * y * rate + 6 * p1 * y + 2 * p2 * x);
    const double over = 1 / (h[6] * mx + h[7] * my + h[8]);
    const double u = (h[0] * mx + h[1] * my + h[2]) * over, v = (h[3] * mx + h[4] * my + h[5]) * over;
    const double a = (h[0] - u * h[6]) * over, b = (h[1] - u * h[7]) * over;
    const double c = (h[3] - v * h[6]) * over, d = (h[4] - v * h[7]) * over;
    return {u, v, a * xx + b * xy, a * xy + b * yy, c * xx + d * xy, c * xy + d * yy, over};
}

// Vergence at which a tilted image sensor is in focus at a depth (mm) behind the lens, minus that of its centre.
inline double tilt_vergence(const double* number, double depth) {
    const double f = number[FOCAL], at = f - number[BREATHING], v = number[VERGENCE];
    const double middle = f / (1 - number[BREATHING] * v);
    const double behind = middle * (1 + at * v) + depth - middle;
    return 1 / (f * behind / (behind - f) - at) - v;
}

// Offsets, and squares and determinants of v W - W V as polynomials of v.
template <bool TILTED>
void compute_images_on(const double* number, double magnification, Workspace& w) {
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const ImagePoint m = image_point(number, magnification, w.px[i], w.py[i]);
            double v00 = w.v00[i], v11 = w.v11[i];
            if constexpr (TILTED) {
                const double more = tilt_vergence(number, m.over);
                v00 -= more, v11 -= more;
            }
            const double s00 = m.w00 * v00 + m.w01 * w.v10[i], s01 = m.w00 * w.v01[i] + m.w01 * v11;
            const double s10 = m.w10 * v00 + m.w11 * w.v10[i], s11 = m.w10 * w.v01[i] + m.w11 * v11;
            w.u[i] = m.u, w.v[i] = m.v;
            w.s0[i] = s00 * s00 + s01 * s01 + s10 * s10 + s11 * s11;
            w.s1[i] = -2 * (m.w00 * s00 + m.w01 * s01 + m.w10 * s10 + m.w11 * s11);
            w.s2[i] = m.w00 * m.w00 + m.w01 * m.w01 + m.w10 * m.w10 + m.w11 * m.w11;
            w.d0[i] = s00 * s11 - s01 * s10;
            w.d1[i] = -(m.w00 * s11 + s00 * m.w11 - m.w01 * s10 - s01 * m.w10);
            w.d2[i] = m.w00 * m.w11 - m.w01 * m.w10;
        }
    }
}

inline void compute_images(const double* number, double magnification, Workspace& w) {
    const double* h = number + IMAGER;
    if (h[6] != 0 || h[7] != 0)
        compute_images_on<true>(number, magnification, w);
    else
        compute_images_on<false>(number, magnification, w);
}

// Twice the squared diameter of the largest blur, at a focused vergence.
inline double max_blur(double at, const Workspace& w) {
    Sum max_square;
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const double square = w.s0[i] + at * (w.s1[i] + at * w.s2[i]);
            const double det = w.d0[i] + at * (w.d1[i] + at * w.d2[i]);
            const double discriminant = max_of(square * square - 4 * det * det, 0.0);
            max_square.part[i - k] = max_of(square + sqrt_of(discriminant), max_square.part[i - k]);
        }
    }
    return max_square.maximum();
}

inline double rms_focus(const Workspace& w) {
    Sum mixed, squares;
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            mixed.part[i - k] -= w.weight[i] * w.s1[i] / 2;
            squares.part[i - k] += w.weight[i] * w.s2[i];
        }
    }
    return mixed.total() / squares.total();
}

inline double minimax_focus(const Workspace& w, int focus_steps) {
    const double golden = (sqrt_of(5.0) - 1) / 2;
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (int i = 0; i < w.lanes; ++i) {
        const double half = w.d1[i] / w.d2[i] / -2, product = w.d0[i] / w.d2[i];
        const double discriminant = sqrt_of(abs_of(half * half - product));
        low = min_of(half - discriminant, low), high = max_of(half + discriminant, high);
    }
    double a = high - golden * (high - low), b = low + golden * (high - low);
    double at_a = max_blur(a, w), at_b = max_blur(b, w);
    for (int i = 0; i < focus_steps; ++i) {
        if (at_a < at_b) {
            high = b, b = a, at_b = at_a;
            a = high - golden * (high - low), at_a = max_blur(a, w);
        } else {
            low = a, a = b, at_a = at_b;
            b = low + golden * (high - low), at_b = max_blur(b, w);
        }
    }
    return (low + high) / 2;
}

// -- compensation.py ---------------------------------------------------------------------------------

inline double dot_product(const double* OMNIMIRROR_RESTRICT row, const double* OMNIMIRROR_RESTRICT vector, int count) {
    Sum sum;
    for (int k = 0; k < count; k += LANE) {
        OMNIMIRROR_LANES(i, k) sum.part[i - k] += row[i] * vector[i];
    }
    return sum.total();
}

inline void subtract_multiple(double amount, const double* OMNIMIRROR_RESTRICT row, double* OMNIMIRROR_RESTRICT vector,
                              int count) {
    for (int k = 0; k < count; k += LANE) {
        OMNIMIRROR_LANES(i, k) vector[i] -= amount * row[i];
    }
}

// Solve a symmetric positive definite system of up to MAX_POSE_PARAMETERS unknowns in place, by Cholesky decomposition.
inline void solve(double (&m)[MAX_POSE_PARAMETERS][MAX_POSE_PARAMETERS], double (&b)[MAX_POSE_PARAMETERS], int n) {
    for (int j = 0; j < n; ++j) {
        for (int i = j; i < n; ++i) {
            double rest = m[i][j];
            for (int k = 0; k < j; ++k) rest -= m[i][k] * m[j][k];
            m[i][j] = i == j ? sqrt_of(rest) : rest / m[j][j];
        }
    }
    for (int i = 0; i < n; ++i) {
        for (int k = 0; k < i; ++k) b[i] -= m[i][k] * b[k];
        b[i] /= m[i][i];
    }
    for (int i = n - 1; i >= 0; --i) {
        for (int k = i + 1; k < n; ++k) b[i] -= m[k][i] * b[k];
        b[i] /= m[i][i];
    }
}

// Fit the pose to the image motion in the basis, by least squares; replace the motion by that of the fitted pose.
inline void fit_pose(const TrialCompensators& c, double (&motion)[MAX_BASIS_ROWS]) {
    double pose[MAX_POSE_PARAMETERS] = {}, displacements[MAX_BASIS_ROWS];
    const int n = c.pose, pairs = n * (n + 1) / 2;
    for (int round = 0; round <= c.iterations; ++round) {
        double normal[MAX_POSE_PARAMETERS][MAX_POSE_PARAMETERS] = {}, right[MAX_POSE_PARAMETERS] = {};
        for (int e = 0; e < c.basis_rows; ++e) {
            double rate[MAX_POSE_PARAMETERS];
            const double *line = c.linear + e * n, *curve = c.quadratic + e * pairs;
            double sum = 0;
            for (int i = 0; i < n; ++i) rate[i] = line[i], sum += line[i] * pose[i];
            for (int i = 0; i < n; ++i) {
                for (int j = i; j < n; ++j, ++curve) {
                    sum += pose[i] * pose[j] * *curve;
                    rate[i] += pose[j] * *curve, rate[j] += pose[i] * *curve;
                }
            }
            displacements[e] = sum;
            for (int i = 0; i < n; ++i) {
                right[i] += rate[i] * (motion[e] - sum);
                for (int j = 0; j <= i; ++j) normal[i][j] += rate[i] * rate[j];
            }
        }
        if (round == c.iterations) break;  // the last round only evaluates the motion
        solve(normal, right, n);
        for (int i = 0; i < n; ++i) pose[i] += right[i];
    }
    for (int e = 0; e < c.basis_rows; ++e) motion[e] = displacements[e];
}

// RMS and maximum of the residual, in px and in deg.
inline void motion_merits(const TrialJob& job, const Workspace& w, double* merits) {
    const double *x = w.residual, *y = w.residual + w.lanes;
    Sum px, deg, max_px, max_deg;
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const double a = w.j00[i] * x[i] + w.j01[i] * y[i], b = w.j10[i] * x[i] + w.j11[i] * y[i];
            const double p = (x[i] * x[i] + y[i] * y[i]) * w.weight[i], q = (a * a + b * b) * w.weight[i];
            px.part[i - k] += p, max_px.part[i - k] = max_of(p, max_px.part[i - k]);
            deg.part[i - k] += q, max_deg.part[i - k] = max_of(q, max_deg.part[i - k]);
        }
    }
    const double n = job.field.count;
    merits[0] = sqrt_of(px.total() / n), merits[1] = sqrt_of(max_px.maximum());
    merits[2] = sqrt_of(deg.total() / n), merits[3] = sqrt_of(max_deg.maximum());
}

inline void calibration_merits(const TrialJob& job, Workspace& w, double* merits) {
    const auto& c = job.compensators;
    const int both = 2 * w.lanes;
    const double *affine = w.compensators, *basis = affine + c.affine_rows * both,
                 *radial = basis + c.basis_rows * both;
    double amount[MAX_COMPENSATOR_ROWS], motion[MAX_BASIS_ROWS];
    for (int r = 0; r < c.affine_rows; ++r) amount[r] = dot_product(affine + r * both, w.residual, both);
    for (int e = 0; e < c.basis_rows; ++e) motion[e] = dot_product(basis + e * both, w.residual, both);
    motion_merits(job, w, merits);
    for (int r = 0; r < c.affine_rows; ++r) {
        subtract_multiple(amount[r], affine + r * both, w.residual, both);
        if (r == 1) motion_merits(job, w, merits + 4);
    }
    motion_merits(job, w, merits + 8);
    fit_pose(c, motion);
    for (int e = 0; e < c.basis_rows; ++e) subtract_multiple(motion[e], basis + e * both, w.residual, both);
    motion_merits(job, w, merits + 12);
    for (int r = 0; r < c.radial_rows; ++r) amount[r] = dot_product(radial + r * both, w.residual, both);
    for (int r = 0; r < c.radial_rows; ++r) subtract_multiple(amount[r], radial + r * both, w.residual, both);
    motion_merits(job, w, merits + 16);
}

// -- merits: compensation.py -------------------------------------------------------------------------

inline void blur_merits(const TrialJob& job, double aperture, double focus, const Workspace& w, double* merits) {
    const double square_mm = aperture * aperture, floor = job.floor;
    Sum diameter, area;
    for (int k = 0; k < w.lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            const double square = square_mm * (w.s0[i] + focus * (w.s1[i] + focus * w.s2[i]));
            const double det = square_mm * (w.d0[i] + focus * (w.d1[i] + focus * w.d2[i]));
            const double discriminant = sqrt_of(max_of(square * square - 4 * det * det, 0.0));
            const double floored = sqrt_of(det * det + floor * square + floor * floor) / w.area[i];
            diameter.part[i - k] = max_of(square + discriminant, diameter.part[i - k]);
            area.part[i - k] = max_of(floored, area.part[i - k]);
        }
    }
    merits[0] = sqrt_of(diameter.maximum() / 2), merits[1] = area.maximum(), merits[2] = 1 / focus;
}

template <bool DISTANT, class S>
void evaluate_trial(const TrialJob& job, int trial, Workspace& w) {
    const double* number = job.numbers + static_cast<int64_t>(trial) * (TRIAL_NUMBERS + job.terms + job.powers);
    double* merits = job.merits + static_cast<int64_t>(trial) * TRIAL_MERITS;
    const S surface(job, number);
    rotate_targets(job, number, w);
    find_mirror_points<DISTANT>(job, surface, number, w);
    const int lost = trace_rays<DISTANT>(job, surface, number, w);
    merits[TRIAL_MERITS - 1] = lost;
    if (lost) {
        for (int i = 0; i < TRIAL_MERITS - 1; ++i) merits[i] = std::numeric_limits<double>::quiet_NaN();
        return;
    }
    compute_images(number, 1.0, w);
    double focus = number[VERGENCE];
    if (job.refocus != NO_REFOCUS) {
        focus = job.refocus == MIN_RMS ? rms_focus(w) : minimax_focus(w, job.search.focus_steps);
        const double f = number[BREATHING];
        compute_images(number, (1 - f * number[VERGENCE]) / (1 - f * focus), w);
    }
    blur_merits(job, number[APERTURE], focus, w, merits + 4 * CALIBRATION_DEPTHS);
    for (int i = 0; i < w.lanes; ++i) {
        w.residual[i] = (w.u[i] - w.refx[i]) * w.weight[i];
        w.residual[w.lanes + i] = (w.v[i] - w.refy[i]) * w.weight[i];
    }
    if (job.displacements)
        for (int i = 0; i < job.field.count; ++i)
            for (int half = 0; half < 2; ++half)
                job.displacements[(2 * static_cast<int64_t>(trial) + half) * job.field.count + i] =
                    w.residual[half * w.lanes + i];
    calibration_merits(job, w, merits);
}

template <class Shape, int ORDER>
void evaluate_range(const TrialJob& job, int first, int count) {
    Workspace w(job);
    for (int trial = first; trial < first + count; ++trial) {
        if (job.field.distant)
            evaluate_trial<true, Surface<Shape, ORDER>>(job, trial, w);
        else
            evaluate_trial<false, Surface<Shape, ORDER>>(job, trial, w);
    }
}

template <class Shape>
void evaluate_shape(const TrialJob& job, int first, int count) {
    if (job.powers == 1) return evaluate_range<Shape, 0>(job, first, count);
    if (job.powers == 15) return evaluate_range<Shape, 4>(job, first, count);
    if (job.powers == 28) return evaluate_range<Shape, 6>(job, first, count);
    evaluate_range<Shape, MAX_FORM_ORDER>(job, first, count);
}

void evaluate_batch(const TrialJob& job, int first, int count) {
    if (job.table.pieces) return evaluate_shape<Table>(job, first, count);
    if (job.terms == 0) return evaluate_shape<Formula<true, 0>>(job, first, count);
    if (job.terms == 4 && !job.is_conic) return evaluate_shape<Formula<false, 4>>(job, first, count);
    if (job.terms == 4) return evaluate_shape<Formula<true, 4>>(job, first, count);
    if (job.terms == 8) return evaluate_shape<Formula<true, 8>>(job, first, count);
    evaluate_shape<Formula<true, 16>>(job, first, count);
}

}  // namespace
}  // namespace omnimirror
