#include "designs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr double DEGREE = 3.14159265358979323846 / 180;
constexpr double HOPE = 0.02;  // of batch/best_focus.py
constexpr int BLOCK = 16;  // designs per piece of work

// The arrays of one design, (angles) each.
struct Scratch {
    explicit Scratch(int angles) : store(size_t(ARRAYS) * angles) {
        double** all[ARRAYS] = {&z,          &slope,      &curvature, &ray,    &magnification_t, &magnification_s,
                                &vergence_t, &vergence_s, &density,   &areas};
        for (int i = 0; i < ARRAYS; ++i) *all[i] = store.data() + size_t(i) * angles;
    }
    static constexpr int ARRAYS = 10;
    std::vector<double> store;
    double *z, *slope, *curvature, *ray, *magnification_t, *magnification_s, *vergence_t, *vergence_s, *density, *areas;
};

// Over the vergence v in focus, the square of the floored area of a mirror point is
//   A^2 = D(v) ((v - v_t)^2 + r(v)) ((v - v_s)^2 + r(v)) / (M_t M_s)^2,
// v_t, v_s the vergences of its images, M_t, M_s its angular magnifications; with b = 1/f - v
//   r = scale (b^2 + airy^2), over b^2 in the paper's mode, and D = delta b^(4 power).
// The camera as a function of the vergence v that it is focused at: batch/best_focus.py, AreaModel.
struct AreaModel {
    double inverse_f, airy2, scale, delta;
    bool paper;
    int power;
    double least, most;  // vergences that the lens can be focused at

    struct At {
        double r, dr, D, d_log_D;
    };

    At at(double v) const {
        const double b = inverse_f - v, b2 = b * b;
        const double r = paper ? scale * (1 + airy2 / b2) : scale * (b2 + airy2);
        const double dr = paper ? 2 * scale * airy2 / (b2 * b) : -2 * scale * b;
        const double D = power == 0 ? delta : power > 0 ? delta * (b2 * b2) : delta / (b2 * b2);
        return {r, dr, D, -4 * power / b};
    }
};

struct Worst {
    double value, rate;
    int angle;
};

// A^2 over D at all angles, to areas; the largest is returned.
double fill_areas(double v, double r, int n, const Scratch& s) {
    const double *vergence_t = s.vergence_t, *vergence_s = s.vergence_s, *density = s.density;
    double* areas = s.areas;
    for (int j = 0; j < n; ++j) {
        const double t = v - vergence_t[j], u = v - vergence_s[j];
        areas[j] = (t * t + r) * (u * u + r) * density[j];
    }
    double most[4] = {areas[0], areas[0], areas[0], areas[0]};  // four chains, which run beside each other
    int j = 0;
    for (; j + 4 <= n; j += 4)
        for (int k = 0; k < 4; ++k) most[k] = most[k] < areas[j + k] ? areas[j + k] : most[k];
    for (; j < n; ++j) most[0] = most[0] < areas[j] ? areas[j] : most[0];
    return std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
}

// The largest A^2, its derivative by v, and at which angle it is.
Worst worst_at(double v, int n, const AreaModel& model, const Scratch& s) {
    const AreaModel::At m = model.at(v);
    const double most = fill_areas(v, m.r, n, s);
    const int j = static_cast<int>(std::find(s.areas, s.areas + n, most) - s.areas) % n;
    const double t = v - s.vergence_t[j], u = v - s.vergence_s[j], value = m.D * most;
    return {value, value * (m.d_log_D + (2 * t + m.dr) / (t * t + m.r) + (2 * u + m.dr) / (u * u + m.r)), j};
}

// Where the worst area, which falls at a and rises at b, is least, to within `close`: the bracket is cut where the
// tangents at both ends meet or, where one angle is the worst at both, at the zero of the chord of its derivatives.
double bottom(double a, double b, double close, const FocusSearch& search, int n, const AreaModel& model,
              const Scratch& s) {
    Worst at_a = worst_at(a, n, model, s), at_b = worst_at(b, n, model, s);
    for (int step = 1; step <= search.most_steps && b - a > close; ++step) {
        const double width = b - a, edge = search.edge * width;
        double c = at_a.angle == at_b.angle
                       ? a - at_a.rate * width / (at_b.rate - at_a.rate)
                       : a + (at_b.value - at_a.value - at_b.rate * width) / (at_a.rate - at_b.rate);
        const bool good = std::isfinite(c) && at_a.rate < 0 && at_b.rate > 0 && step % search.halving;
        c = good ? std::min(std::max(c, a + edge), b - edge) : (a + b) / 2;
        const Worst at_c = worst_at(c, n, model, s);
        if (at_c.rate > 0)
            b = c, at_b = at_c;
        else
            a = c, at_a = at_c;
    }
    return (a + b) / 2;
}

double best_vergence(const FocusSearch& search, int n, const AreaModel& model, const Scratch& s) {
    double low = std::numeric_limits<double>::infinity(), high = -low;
    for (int j = 0; j < n; ++j) {
        low = std::min(low, std::min(s.vergence_t[j], s.vergence_s[j]));
        high = std::max(high, std::max(s.vergence_t[j], s.vergence_s[j]));
    }
    const double margin = search.margin * (high - low);
    low = std::min(std::max(low - margin, model.least), model.most);
    high = std::min(std::max(high + margin, model.least), model.most);
    const double step = (high - low) / (search.scan - 1);
    std::vector<Worst> seen(search.scan);
    int best = 0;
    for (int i = 0; i < search.scan; ++i) {
        seen[i] = worst_at(low + i * step, n, model, s);
        if (seen[i].value < seen[best].value) best = i;
    }
    best = std::min(std::max(best, 1), search.scan - 2);
    const double close = search.close * (high - low);
    double v = bottom(low + (best - 1) * step, low + (best + 1) * step, close, search, n, model, s);
    const double known = worst_at(v, n, model, s).value;
    double least = known;
    for (int i = 0; i + 1 < search.scan; ++i) {  // other valleys that tangents hint at: _other_valleys
        const Worst &a = seen[i], &b = seen[i + 1];
        const double cut = (b.value - a.value - b.rate * step) / (a.rate - b.rate);
        if (!(cut > 0 && cut < step && a.value + a.rate * cut < known * (1 + HOPE))) continue;
        const bool between = a.rate < 0 && b.rate > 0, hidden = a.angle != b.angle && a.rate * b.rate > 0;
        if (!(between || hidden) || (between && (i == best - 1 || i == best))) continue;
        const double left = low + i * step, middle = left + cut;
        const bool rises = worst_at(middle, n, model, s).rate > 0;
        const double other = rises ? bottom(left, middle, close, search, n, model, s)
                                   : bottom(middle, low + (i + 1) * step, close, search, n, model, s);
        const double lower = worst_at(other, n, model, s).value;
        if (lower < least) v = other, least = lower;
    }
    return v;
}

// z/M, z' and M z'' of z/M = sum c_k B_k(x/M), added up term by term, and of a conic with vertex radius R and
// constant k: z = x^2 / (R (1 + w)), z' = x / (R w), z'' = 1 / (R w^3), w^2 = 1 - (1 + k) (x/R)^2.
void fill_profile(const DesignJob& job, int i, double M, const Scratch& s) {
    const int n = job.angles;
    std::fill_n(s.z, 3 * size_t(n), 0.0);  // z, slope and curvature adjoin
    for (int k = 0; k < job.terms; ++k) {
        const double c = job.coefficients[size_t(i) * job.terms + k];
        const size_t row = size_t(k) * n;
        for (int j = 0; j < n; ++j) {
            s.z[j] += c * job.sag[row + j];
            s.slope[j] += c * job.slope[row + j];
            s.curvature[j] += c * job.curvature[row + j];
        }
    }
    if (!job.has_conic) return;
    const double R = job.numbers[size_t(i) * DESIGN_NUMBERS + 4] / M, conic = job.numbers[size_t(i) * DESIGN_NUMBERS + 5];
    for (int j = 0; j < n; ++j) {
        const double x = job.fractions[j], t = x / R, root = std::sqrt(1 - (1 + conic) * (t * t));
        s.z[j] += x * x / (R * (1 + root));
        s.slope[j] += x / (R * root);
        s.curvature[j] += 1 / (R * (root * root * root));
    }
}

// A mirror point under a perspective lens and under a telecentric one: batch/optics.py. True where it can be used.
struct Point {
    double x, z, slope, curvature, slope_over_x, inverse_distance;
};

// With w = m + z, rho^2 = w^2 + x^2, g = w - x z', e = 1 + z'^2, s = 2 w z'/x + 1 - z'^2:
//   dOmega/dx = 2 z''/e + g/rho^2 (Eq. 8), M_t = g / (w^2 dOmega/dx), M_s = rho e / (w s) (Eqs. 9, 10),
//   v = 1 / (w (1 + q/rho)) (Eqs. 34, 35), q_t = 1 / (2 z'' / (e^1.5 cos gamma) + 1/p), q_s = 1 / (2 cos gamma z'/(x e^.5) + 1/p).
bool fill_perspective(const Point& p, double m, int j, const Scratch& s, double& viewpoint) {
    const double w = m + p.z, steep = 1 + p.slope * p.slope, root = std::sqrt(steep);
    const double to_lens = w * w + p.x * p.x, rho = std::sqrt(to_lens), front = w - p.x * p.slope;
    const double cos_gamma = front / (root * rho), sine = 2 * w * p.slope_over_x + 1 - p.slope * p.slope;
    const double q_t = 1 / (2 * p.curvature / (steep * root * cos_gamma) + p.inverse_distance);
    const double q_s = 1 / (2 * cos_gamma * p.slope_over_x / root + p.inverse_distance);
    const double domega_dx = 2 * p.curvature / steep + front / to_lens;
    s.ray[j] = p.x / w;
    s.magnification_t[j] = front / (w * w * domega_dx);
    s.magnification_s[j] = rho * steep / (w * sine);
    s.vergence_t[j] = 1 / (w * (1 + q_t / rho));
    s.vergence_s[j] = 1 / (w * (1 + q_s / rho));
    viewpoint = p.z + (w * (1 - p.slope * p.slope) - 2 * p.slope * p.x) / sine;
    return domega_dx > 0 && front > 0 && s.magnification_s[j] > 0;
}

// The limit of m without end: dOmega/dx = 2 z''/e, M_t = dx/dOmega, M_s = e x / (2 z'), v = -(z + q).
bool fill_telecentric(const Point& p, int j, const Scratch& s, double& viewpoint) {
    const double steep = 1 + p.slope * p.slope, domega_dx = 2 * p.curvature / steep;
    s.ray[j] = p.x;
    s.magnification_t[j] = 1 / domega_dx;
    s.magnification_s[j] = steep / (2 * p.slope_over_x);
    s.vergence_t[j] = -(p.z + 1 / (domega_dx + p.inverse_distance));
    s.vergence_s[j] = -(p.z + 1 / (2 * p.slope_over_x / steep + p.inverse_distance));
    viewpoint = p.z + (1 - p.slope * p.slope) / (2 * p.slope_over_x);
    return domega_dx > 0 && s.magnification_s[j] > 0;
}

// Everything that does not depend on the focus; whether the design can be used.
bool fill_points(const DesignJob& job, const double* number, const Scratch& s, double* omega, double* viewpoint) {
    const double m = number[0], M = number[1];
    const bool telecentric = number[6] > 0;
    bool valid = true;
    for (int j = 0; j < job.angles; ++j) {
        const double x = job.fractions[j] * M, slope = s.slope[j], curvature = s.curvature[j] / M;
        const Point p{x, s.z[j] * M, slope, curvature, x > 0 ? slope / x : curvature, job.inverse_distance[j]};
        valid &= telecentric ? fill_telecentric(p, j, s, viewpoint[j]) : fill_perspective(p, m, j, s, viewpoint[j]);
    }
    for (int j = 0; j < job.angles; ++j)
        omega[j] = 2 * std::atan(s.slope[j]) + (telecentric ? 0.0 : std::atan(s.ray[j]));
    for (int j = 0; j < job.angles; ++j) {
        const double product = s.magnification_t[j] * s.magnification_s[j];
        s.density[j] = omega[j] < job.least_omega ? 0.0 : 1 / (product * product);
    }
    return valid;
}

// What a lens and its pixels make of vergences and ray coordinates.
struct Camera {
    double f, mu, blur, image, airy;  // airy: per mm of image distance; of a telecentric lens the disk itself
    bool telecentric, scaled, paper;

    Camera(const DesignJob& job, const double* number, double rim_ray)
        : f(number[2]), mu(number[6]), telecentric(number[6] > 0), scaled(job.image_radius > 0), paper(job.paper) {
        const double F = number[3], disk = 2.44e-6 * job.wavelength * F / job.pitch;
        blur = telecentric ? mu * mu / (F * job.pitch) : f / (F * job.pitch) * (paper ? f : 1.0);
        image = scaled ? job.image_radius / rim_ray : (telecentric ? mu : 1.0) / job.pitch;
        airy = telecentric ? disk : disk / f;
    }

    AreaModel model() const {
        const double ratio = blur / (image * DEGREE), delta = ratio * ratio * ratio * ratio, per_blur = 1 / (blur * blur);
        const double endless = std::numeric_limits<double>::infinity();
        if (telecentric) return {endless, 0.0, (1 + airy * airy) * per_blur, delta, true, 0, -endless, endless};
        return {1 / f, airy * airy, per_blur, delta, paper, int(paper) - int(scaled), 1e-7 / f, 0.999 / f};
    }
};

void evaluate_one(const DesignJob& job, int i, const Scratch& s) {
    const int n = job.angles;
    const double* number = job.numbers + size_t(i) * DESIGN_NUMBERS;
    const size_t plane = size_t(job.designs) * n;
    double* row = job.columns + size_t(i) * n;
    double* omega = row;
    fill_profile(job, i, number[1], s);
    const bool valid = fill_points(job, number, s, omega, row + 4 * plane);
    const Camera camera(job, number, s.ray[n - 1]);
    const AreaModel model = camera.model();
    const double v = best_vergence(job.search, n, model, s), b = camera.telecentric ? 1.0 : 1 / (1 / camera.f - v);
    const double ray_px = camera.image * (camera.scaled ? 1.0 : b);
    const double vergence_px = camera.blur * (camera.paper ? 1.0 : b);
    const double airy = camera.airy * b, floor = 1 + airy * airy;
    double *h = row + plane, *dh = row + 2 * plane, *dw = row + 3 * plane, *L_t = row + 5 * plane,
           *L_s = row + 6 * plane, *t = row + 7 * plane, *u = row + 8 * plane, *area = row + 9 * plane;
    for (int j = 0; j < n; ++j) {
        omega[j] /= DEGREE;
        h[j] = s.ray[j] * ray_px;
        dh[j] = s.magnification_t[j] * ray_px * DEGREE;
        dw[j] = s.magnification_s[j] * ray_px * DEGREE;
        L_t[j] = camera.telecentric ? -s.vergence_t[j] : 1 / s.vergence_t[j];
        L_s[j] = camera.telecentric ? -s.vergence_s[j] : 1 / s.vergence_s[j];
        t[j] = vergence_px * (v - s.vergence_t[j]);
        u[j] = vergence_px * (v - s.vergence_s[j]);
        area[j] = std::sqrt((t[j] * t[j] + floor) * (u[j] * u[j] + floor)) / (dh[j] * dw[j]);
    }
    const AreaModel::At at = model.at(v);
    job.focus[i] = camera.telecentric ? -v : 1 / v;
    job.worst[i] = std::sqrt(at.D * fill_areas(v, at.r, n, s));
    job.valid[i] = valid;
}

void evaluate_block(void* context, int block) {
    const DesignJob& job = *static_cast<const DesignJob*>(context);
    const Scratch scratch(job.angles);
    const int end = std::min(job.designs, (block + 1) * BLOCK);
    for (int i = block * BLOCK; i < end; ++i) evaluate_one(job, i, scratch);
}

}  // namespace

void evaluate_designs(const DesignJob& job) {
    DesignJob copy = job;
    parallel_for((job.designs + BLOCK - 1) / BLOCK, &evaluate_block, &copy);
}

}  // namespace omnimirror
