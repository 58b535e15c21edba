#include "designs.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "built.hpp"
#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr double DEGREE = 3.14159265358979323846 / 180;
constexpr double HOPE = 0.02;  // of batch/best_focus.py
constexpr int BLOCK = 16;  // designs per piece of work

// The arrays of one design, (angles) each.
struct Scratch {
    Scratch(int angles, bool real_lens) : store(size_t(ARRAYS) * angles), parabolas(real_lens ? 18 * size_t(angles) : 0) {
        double** all[ARRAYS] = {&z,          &slope,      &curvature, &ray,    &magnification_t, &magnification_s,
                                &vergence_t, &vergence_s, &density,   &areas};
        for (int i = 0; i < ARRAYS; ++i) *all[i] = store.data() + size_t(i) * angles;
    }
    static constexpr int ARRAYS = 10;
    std::vector<double> store;
    std::vector<double> parabolas;  // of a real lens, (18, angles): see RealAreas
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

// The largest of some numbers: four chains, which run beside each other.
double largest(const double* values, int n) {
    double most[4] = {values[0], values[0], values[0], values[0]};
    int j = 0;
    for (; j + 4 <= n; j += 4)
        for (int k = 0; k < 4; ++k) most[k] = most[k] < values[j + k] ? values[j + k] : most[k];
    for (; j < n; ++j) most[0] = most[0] < values[j] ? values[j] : most[0];
    return std::max(std::max(most[0], most[1]), std::max(most[2], most[3]));
}

// The floored areas of a design with an ideal lens, wherever it is focused.
class IdealAreas {
public:
    IdealAreas(int n, const AreaModel& model, const Scratch& s) : n_(n), model_(model), s_(s) {}

    std::pair<double, double> range(double margin) const {
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (int j = 0; j < n_; ++j) {
            low = std::fmin(low, std::fmin(s_.vergence_t[j], s_.vergence_s[j]));
            high = std::fmax(high, std::fmax(s_.vergence_t[j], s_.vergence_s[j]));
        }
        const double more = margin * (high - low);
        return {std::min(std::max(low - more, model_.least), model_.most),
                std::min(std::max(high + more, model_.least), model_.most)};
    }

    // The largest A^2, its derivative by v, and at which angle it is.
    Worst worst(double v) const {
        const AreaModel::At m = model_.at(v);
        const double most = fill(v, m.r);
        const int j = static_cast<int>(std::find(s_.areas, s_.areas + n_, most) - s_.areas) % n_;
        const double t = v - s_.vergence_t[j], u = v - s_.vergence_s[j], value = m.D * most;
        return {value, value * (m.d_log_D + (2 * t + m.dr) / (t * t + m.r) + (2 * u + m.dr) / (u * u + m.r)), j};
    }

private:
    // A^2 over D at all angles; the largest is returned.
    double fill(double v, double r) const {
        const double *vergence_t = s_.vergence_t, *vergence_s = s_.vergence_s, *density = s_.density;
        double* areas = s_.areas;
        for (int j = 0; j < n_; ++j) {
            const double t = v - vergence_t[j], u = v - vergence_s[j];
            areas[j] = (t * t + r) * (u * u + r) * density[j];
        }
        return largest(areas, n_);
    }

    int n_;
    AreaModel model_;
    const Scratch& s_;
};

// The floored areas of a design with a real lens: signed and own blur (px) and resolution (px/deg) are parabolas of the
// lens's q at each angle; batch/best_focus.py, RealAreas.
class RealAreas {
public:
    enum Side { T, S, OWN_T, OWN_S, DH, DW, SIDES };

    RealAreas(int n, const Lens& lens, double airy, const Scratch& s)
        : n_(n), lens_(lens), airy_(airy), airy_slope_(airy * (1 - lens.table().e / lens.table().f)), s_(s) {}

    double* power(Side side, int i) const { return const_cast<double*>(s_.parabolas.data()) + size_t(3 * side + i) * n_; }

    double at(Side side, int j, double q) const {
        return power(side, 0)[j] + q * (power(side, 1)[j] + q * power(side, 2)[j]);
    }

    double rate(Side side, int j, double q) const { return power(side, 1)[j] + 2 * q * power(side, 2)[j]; }

    double airy(double q) const { return airy_ + airy_slope_ * q; }

    // Of the vergences (middle) at which single blurs are 0, nearly.
    std::pair<double, double> range(double margin) const {
        const double least = lens_.table().least, most = lens_.table().most;
        double low = std::numeric_limits<double>::infinity(), high = -low;
        for (int j = 0; j < n_; ++j) {
            low = std::fmin(low, std::fmin(s_.z[j], s_.slope[j]));
            high = std::fmax(high, std::fmax(s_.z[j], s_.slope[j]));
        }
        const double more = margin * (high - low);
        return {std::min(std::max(low - more, least), most), std::min(std::max(high + more, least), most)};
    }

    Worst worst(double v) const {
        const double q = lens_.defocus(v), disk = airy(q), floor = 1 + disk * disk;
        const double* p = s_.parabolas.data();
        const size_t n = n_;
        const auto parabola = [p, n, q](int side, size_t j) {
            const double* c = p + 3 * side * n + j;
            return c[0] + q * (c[n] + q * c[2 * n]);
        };
        for (size_t j = 0; j < n; ++j) {
            const double t = parabola(T, j), u = parabola(S, j), own_t = parabola(OWN_T, j), own_s = parabola(OWN_S, j);
            const double scale = parabola(DH, j) * parabola(DW, j);
            s_.areas[j] = (t * t + own_t * own_t + floor) * (u * u + own_s * own_s + floor) / (scale * scale) * s_.density[j];
        }
        const double most = largest(s_.areas, n_);
        const int j = static_cast<int>(std::find(s_.areas, s_.areas + n_, most) - s_.areas) % n_;
        const double t = at(T, j, q), u = at(S, j, q), own_t = at(OWN_T, j, q), own_s = at(OWN_S, j, q);
        const double dfloor = 2 * disk * airy_slope_;
        const double side_t = 2 * (t * rate(T, j, q) + own_t * rate(OWN_T, j, q)) + dfloor;
        const double side_s = 2 * (u * rate(S, j, q) + own_s * rate(OWN_S, j, q)) + dfloor;
        const double d = side_t / (t * t + own_t * own_t + floor) + side_s / (u * u + own_s * own_s + floor) -
                         2 * (rate(DH, j, q) / at(DH, j, q) + rate(DW, j, q) / at(DW, j, q));
        return {most, most * d * lens_.defocus_rate(v), j};
    }

private:
    int n_;
    Lens lens_;
    double airy_, airy_slope_;
    const Scratch& s_;
};

// Where the worst area, which falls at a and rises at b, is least, to within `close`: the bracket is cut where the
// tangents at both ends meet or, where one angle is the worst at both, at the zero of the chord of its derivatives.
template <class Areas>
double bottom(double a, double b, double close, const FocusSearch& search, const Areas& areas) {
    Worst at_a = areas.worst(a), at_b = areas.worst(b);
    for (int step = 1; step <= search.most_steps && b - a > close; ++step) {
        const double width = b - a, edge = search.edge * width;
        double c = at_a.angle == at_b.angle
                       ? a - at_a.rate * width / (at_b.rate - at_a.rate)
                       : a + (at_b.value - at_a.value - at_b.rate * width) / (at_a.rate - at_b.rate);
        const bool good = std::isfinite(c) && at_a.rate < 0 && at_b.rate > 0 && step % search.halving;
        c = good ? std::min(std::max(c, a + edge), b - edge) : (a + b) / 2;
        const Worst at_c = areas.worst(c);
        if (at_c.rate > 0)
            b = c, at_b = at_c;
        else
            a = c, at_a = at_c;
    }
    return (a + b) / 2;
}

template <class Areas>
double best_vergence(const FocusSearch& search, const Areas& areas) {
    const auto [low, high] = areas.range(search.margin);
    const double step = (high - low) / (search.scan - 1);
    std::vector<Worst> seen(search.scan);
    int best = 0;
    for (int i = 0; i < search.scan; ++i) {
        seen[i] = areas.worst(low + i * step);
        if (seen[i].value < seen[best].value) best = i;
    }
    best = std::min(std::max(best, 1), search.scan - 2);
    const double close = search.close * (high - low);
    double v = bottom(low + (best - 1) * step, low + (best + 1) * step, close, search, areas);
    const double known = areas.worst(v).value;
    double least = known;
    for (int i = 0; i + 1 < search.scan; ++i) {  // other valleys that tangents hint at: _other_valleys
        const Worst &a = seen[i], &b = seen[i + 1];
        const double cut = (b.value - a.value - b.rate * step) / (a.rate - b.rate);
        if (!(cut > 0 && cut < step && a.value + a.rate * cut < known * (1 + HOPE))) continue;
        const bool between = a.rate < 0 && b.rate > 0, hidden = a.angle != b.angle && a.rate * b.rate > 0;
        if (!(between || hidden) || (between && (i == best - 1 || i == best))) continue;
        const double left = low + i * step, middle = left + cut;
        const bool rises = areas.worst(middle).rate > 0;
        const double other = rises ? bottom(left, middle, close, search, areas)
                                   : bottom(middle, low + (i + 1) * step, close, search, areas);
        const double lower = areas.worst(other).value;
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

// Where the columns of one design go, (angles) each.
struct Row {
    Row(const DesignJob& job, int i) {
        double** all[DESIGN_COLUMNS] = {&omega, &h, &dh, &dw, &viewpoint, &L_t, &L_s, &t, &s, &area};
        for (int c = 0; c < DESIGN_COLUMNS; ++c)
            *all[c] = job.columns + (size_t(c) * job.designs + i) * job.angles;
    }
    double *omega, *h, *dh, *dw, *viewpoint, *L_t, *L_s, *t, *s, *area;
};

// Columns of a design with an ideal lens at its best focus, from what its mirror points do.
void finish_ideal(const DesignJob& job, int i, const Scratch& s, const Row& row) {
    const int n = job.angles;
    const Camera camera(job, job.numbers + size_t(i) * DESIGN_NUMBERS, s.ray[n - 1]);
    const AreaModel model = camera.model();
    const IdealAreas areas(n, model, s);
    const double v = best_vergence(job.search, areas), b = camera.telecentric ? 1.0 : 1 / (1 / camera.f - v);
    const double ray_px = camera.image * (camera.scaled ? 1.0 : b);
    const double vergence_px = camera.blur * (camera.paper ? 1.0 : b);
    const double airy = camera.airy * b, floor = 1 + airy * airy;
    for (int j = 0; j < n; ++j) {
        row.omega[j] /= DEGREE;
        row.h[j] = s.ray[j] * ray_px;
        row.dh[j] = s.magnification_t[j] * ray_px * DEGREE;
        row.dw[j] = s.magnification_s[j] * ray_px * DEGREE;
        row.L_t[j] = camera.telecentric ? -s.vergence_t[j] : 1 / s.vergence_t[j];
        row.L_s[j] = camera.telecentric ? -s.vergence_s[j] : 1 / s.vergence_s[j];
        row.t[j] = vergence_px * (v - s.vergence_t[j]);
        row.s[j] = vergence_px * (v - s.vergence_s[j]);
        row.area[j] = std::sqrt((row.t[j] * row.t[j] + floor) * (row.s[j] * row.s[j] + floor)) / (row.dh[j] * row.dw[j]);
    }
    job.focus[i] = camera.telecentric ? -v : 1 / v;
    job.worst[i] = std::sqrt(areas.worst(v).value);
}

// The parabolas of a design with a real lens; `place` gets where its pupil stands at each angle.
void fill_parabolas(const DesignJob& job, const Lens& lens, const RealAreas& areas, const Scratch& s, double* height,
                    double* place) {
    const int n = job.angles;
    const LensTable& table = lens.table();
    const double wide = table.f / table.f_number / job.pitch, scale = DEGREE / job.pitch;
    double mean = 0.0;
    int known = 0;
    for (int j = 0; j < n; ++j) {
        const double both = s.vergence_t[j] + s.vergence_s[j];
        if (both == both) mean += both, ++known;
    }
    const double guess = std::min(std::max(mean / known / 2, table.least), table.most), q = lens.defocus(guess);
    for (int j = 0; j < n; ++j) {
        double row[LENS_ROWS];
        lens.at(s.ray[j], LENS_ROWS, row);
        const double *h = row + 3, *rate = row + 6, *far_t = row + 9, *spread_t = row + 12, *far_s = row + 15,
                     *spread_s = row + 18, *own = row + 21;
        const auto at = [q](const double* c) { return c[0] + q * (c[1] + q * c[2]); };
        s.z[j] = s.vergence_t[j] - at(far_t) / at(spread_t) + guess;  // z and slope are done with
        s.slope[j] = s.vergence_s[j] - at(far_s) / at(spread_s) + guess;
        place[j] = row[0];
        for (int i = 0; i < 3; ++i) {
            areas.power(RealAreas::T, i)[j] = wide * (far_t[i] - spread_t[i] * s.vergence_t[j]);
            areas.power(RealAreas::S, i)[j] = wide * (far_s[i] - spread_s[i] * s.vergence_s[j]);
            areas.power(RealAreas::OWN_T, i)[j] = own[i] / job.pitch;
            areas.power(RealAreas::OWN_S, i)[j] = own[3 + i] / job.pitch;
            areas.power(RealAreas::DH, i)[j] = scale * rate[i] * s.magnification_t[j];
            areas.power(RealAreas::DW, i)[j] = scale * s.magnification_s[j] * (s.ray[j] == 0 ? rate[i] : h[i] / s.ray[j]);
            height[size_t(i) * n + j] = h[i] / job.pitch;
        }
    }
}

void finish_real(const DesignJob& job, int i, const Lens& lens, const Scratch& s, const Row& row) {
    const int n = job.angles;
    const double disk = 2.44e-6 * job.wavelength * lens.table().f_number / job.pitch;
    const RealAreas areas(n, lens, disk, s);
    std::vector<double> more(4 * size_t(n));  // image heights by powers of q; the pupil's places
    double *height = more.data(), *place = height + 3 * size_t(n);
    fill_parabolas(job, lens, areas, s, height, place);
    const double v = best_vergence(job.search, areas), q = lens.defocus(v), airy = areas.airy(q), floor = 1 + airy * airy;
    for (int j = 0; j < n; ++j) {
        const auto at = [&areas, j, q](RealAreas::Side side) { return areas.at(side, j, q); };
        row.omega[j] /= DEGREE;
        row.h[j] = height[j] + q * (height[n + j] + q * height[2 * n + j]);
        row.dh[j] = at(RealAreas::DH);
        row.dw[j] = at(RealAreas::DW);
        row.L_t[j] = 1 / s.vergence_t[j] + place[j];
        row.L_s[j] = 1 / s.vergence_s[j] + place[j];
        row.t[j] = at(RealAreas::T);
        row.s[j] = at(RealAreas::S);
        const double own_t = at(RealAreas::OWN_T), own_s = at(RealAreas::OWN_S);
        row.area[j] = std::sqrt((row.t[j] * row.t[j] + own_t * own_t + floor) *
                                (row.s[j] * row.s[j] + own_s * own_s + floor)) / (row.dh[j] * row.dw[j]);
    }
    job.focus[i] = 1 / v + lens.table().pupil;
    job.worst[i] = std::sqrt(areas.worst(v).value);
}

Wall wall_of(const DesignJob& job, int i) {
    if (job.wall_kind == Wall::NONE) return {Wall::NONE, 0, 0, 0, 0, 0, 0, true, 1.0, 1.0};
    const double* w = job.walls + size_t(i) * WALL_NUMBERS;
    return {job.wall_kind, w[0], w[1], w[2], w[3], w[4], w[5], w[6] > 0, job.wall_index, job.medium_index};
}

// As fill_points, of a design with a real lens or behind a wall.
bool fill_built(const DesignJob& job, int i, const Lens& lens, const Scratch& s, const Row& row) {
    const double* number = job.numbers + size_t(i) * DESIGN_NUMBERS;
    const double m = number[0], M = number[1];
    const bool telecentric = number[6] > 0;
    const Wall wall = wall_of(job, i);
    bool valid = true;
    for (int j = 0; j < job.angles; ++j) {
        const double x = job.fractions[j] * M, z = s.z[j] * M, slope = s.slope[j], curvature = s.curvature[j] / M;
        Aim aim{m + z, telecentric ? 0.0 : x / (m + z), 0.0};
        if (lens.known()) {
            double rows[2];
            aim.tangent = lens.aimed(x, m + z);
            lens.at(aim.tangent, 2, rows);
            aim = {m + z - rows[0], aim.tangent, rows[1] * (1 + aim.tangent * aim.tangent)};
            valid &= aim.tangent <= lens.table().end * (1 + 1e-12);
        }
        const double over_x = x > 0 ? slope / x : curvature;
        const Node node = built_point(x, z, slope, curvature, over_x, job.inverse_distance[j], aim, telecentric, wall);
        valid &= node.usable;
        const double product = node.magnification_t * node.magnification_s;
        const bool counts = node.seen && node.omega >= job.least_omega;
        row.omega[j] = node.omega;
        row.viewpoint[j] = node.viewpoint;
        s.ray[j] = node.ray;
        s.magnification_t[j] = node.magnification_t;
        s.magnification_s[j] = node.magnification_s;
        s.vergence_t[j] = node.vergence_t;
        s.vergence_s[j] = node.vergence_s;
        s.density[j] = !counts ? 0.0 : lens.known() ? 1.0 : 1 / (product * product);
        s.areas[j] = node.seen;
    }
    const int rim = job.angles - 1;
    for (int j = 0; j < rim; ++j) {  // what is not seen does as the rim does, and does not count
        if (s.areas[j] != 0) continue;
        for (double* values : {s.magnification_t, s.magnification_s, s.vergence_t, s.vergence_s}) values[j] = values[rim];
    }
    return valid;
}

// What is not seen has no columns.
void blank_unseen(const DesignJob& job, int i, const std::vector<bool>& seen) {
    for (int c = 0; c < DESIGN_COLUMNS; ++c) {
        double* column = job.columns + (size_t(c) * job.designs + i) * job.angles;
        for (int j = 0; j < job.angles; ++j)
            if (!seen[j]) column[j] = std::numeric_limits<double>::quiet_NaN();
    }
}

void evaluate_one(const DesignJob& job, int i, const Scratch& s) {
    const double* number = job.numbers + size_t(i) * DESIGN_NUMBERS;
    const Row row(job, i);
    const Lens lens(job.lens);
    fill_profile(job, i, number[1], s);
    if (!lens.known() && job.wall_kind == Wall::NONE) {
        job.valid[i] = fill_points(job, number, s, row.omega, row.viewpoint);
        return finish_ideal(job, i, s, row);
    }
    job.valid[i] = fill_built(job, i, lens, s, row);
    const std::vector<bool> seen(s.areas, s.areas + job.angles);
    if (lens.known())
        finish_real(job, i, lens, s, row);
    else
        finish_ideal(job, i, s, row);
    blank_unseen(job, i, seen);
}

void evaluate_block(void* context, int block) {
    const DesignJob& job = *static_cast<const DesignJob*>(context);
    const Scratch scratch(job.angles, job.lens.values != nullptr);
    const int end = std::min(job.designs, (block + 1) * BLOCK);
    for (int i = block * BLOCK; i < end; ++i) evaluate_one(job, i, scratch);
}

}  // namespace

void evaluate_designs(const DesignJob& job) {
    DesignJob copy = job;
    parallel_for((job.designs + BLOCK - 1) / BLOCK, &evaluate_block, &copy);
}

}  // namespace omnimirror
