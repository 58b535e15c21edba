// Best focus of one design, with the steps of batch/best_focus.py.
//
// At the focused vergence v, the square of the floored area of a mirror point is
//   A^2 = D(v) ((v - v_t)^2 + r(v)) ((v - v_s)^2 + r(v)) / (M_t M_s)^2,
// with v_t, v_s the vergences of its images and M_t, M_s its angular magnifications; with b = 1/f - v
//   r = scale (b^2 + airy^2), divided by b^2 in the paper's mode, and D = delta b^(4 power).
#pragma once

#include <limits>

#include "real_rays.hpp"
#include "workspace.hpp"

namespace omnimirror {
namespace {

constexpr double UNBOUNDED = std::numeric_limits<double>::infinity();
constexpr double TANGENT_MARGIN = 0.02;  // of batch/best_focus.py

// The camera as a function of its focused vergence v: batch/best_focus.py, AreaModel.
struct AreaModel {
    double inverse_f, airy2, scale, delta;
    bool paper;
    int power;
    double minimum, maximum;  // limits of the focusable vergences

    struct At {
        double r, dr, D, d_log_D;
    };

    At at(double v) const {
        const double b = inverse_f - v, over = 1 / b, b2 = b * b, over2 = over * over;
        const double r = paper ? scale * (1 + airy2 * over2) : scale * (b2 + airy2);
        const double dr = paper ? 2 * scale * airy2 * (over2 * over) : -2 * scale * b;
        const double D = power == 0 ? delta : power > 0 ? delta * (b2 * b2) : delta * (over2 * over2);
        return {r, dr, D, -4 * power * over};
    }
};

struct MaxArea {
    double value, rate;
    int angle;
};

// Running maximum of values, per lane, with the index of its first occurrence.
struct RunningMax {
    double value[LANE], from[LANE];

    RunningMax() {
        for (int l = 0; l < LANE; ++l) value[l] = -UNBOUNDED, from[l] = 0.0;
    }

    void update(int l, double k, double samples) {
        const bool more = samples > value[l];
        from[l] = more ? k : from[l];
        value[l] = more ? samples : value[l];
    }

    // NaN is never the maximum.
    int index() const {
        double maximum = value[0];
        for (double v : value) maximum = max_of(v, maximum);
        double first = UNBOUNDED;
        for (int l = 0; l < LANE; ++l) first = value[l] == maximum ? min_of(first, from[l] + l) : first;
        return static_cast<int>(first);
    }
};

// Limits of the scanned vergences: those of the images, with a margin, within the focusable range.
struct Range {
    double low, high;
};

inline Range range_of(const double* OMNIMIRROR_RESTRICT t, const double* OMNIMIRROR_RESTRICT s, int lanes,
                      double margin, double minimum, double maximum) {
    double lows[LANE], highs[LANE], low = UNBOUNDED, high = -UNBOUNDED;
    for (int l = 0; l < LANE; ++l) lows[l] = UNBOUNDED, highs[l] = -UNBOUNDED;
    for (int k = 0; k < lanes; k += LANE) {
        OMNIMIRROR_LANES(i, k) {
            lows[i - k] = min_of(t[i], min_of(s[i], lows[i - k]));
            highs[i - k] = max_of(t[i], max_of(s[i], highs[i - k]));
        }
    }
    for (int l = 0; l < LANE; ++l) low = min_of(lows[l], low), high = max_of(highs[l], high);
    const double more = margin * (high - low);
    return {min_of(max_of(low - more, minimum), maximum), min_of(max_of(high + more, minimum), maximum)};
}

// Floored areas of a design with an ideal lens, at any focus.
class IdealAreas {
  public:
    IdealAreas(const AreaModel& model, const Workspace& w) : model_(model), w_(w) {}

    Range range(double margin) const {
        return range_of(w_.vergence_t, w_.vergence_s, w_.lanes, margin, model_.minimum, model_.maximum);
    }

    // The maximum A^2, its derivative with respect to v, and its angle index.
    MaxArea max_area(double v) const {
        const AreaModel::At m = model_.at(v);
        const double r = m.r;
        const double* OMNIMIRROR_RESTRICT vergence_t = w_.vergence_t;
        const double* OMNIMIRROR_RESTRICT vergence_s = w_.vergence_s;
        const double* OMNIMIRROR_RESTRICT density = w_.density;
        RunningMax maximum;
        for (int k = 0; k < w_.lanes; k += LANE) {
            OMNIMIRROR_LANES(i, k) {
                const double t = v - vergence_t[i], u = v - vergence_s[i];
                maximum.update(i - k, k, (t * t + r) * (u * u + r) * density[i]);
            }
        }
        const int j = maximum.index();
        const double t = v - vergence_t[j], u = v - vergence_s[j], side_t = t * t + r, side_s = u * u + r;
        const double value = m.D * side_t * side_s * density[j];
        const double rate = ((2 * t + m.dr) * side_s + (2 * u + m.dr) * side_t) / (side_t * side_s);
        return {value, value * (m.d_log_D + rate), j};
    }

  private:
    AreaModel model_;
    const Workspace& w_;
};

// Floored areas of a design with a real lens. Signed blur, the lens's own blur (px) and the resolution (px/deg) are
// parabolas in the lens's q at each angle; batch/best_focus.py, RealAreas.
class RealAreas {
  public:
    enum Side { T, S, OWN_T, OWN_S, DH_OF, DW_OF };

    RealAreas(const Lens& lens, double airy, const Workspace& w)
        : lens_(lens), airy_(airy), airy_slope_(airy * (1 - lens.table().e / lens.table().f)), w_(w) {}

    double* power(int side, int i) const { return w_.parabolas + (3 * side + i) * w_.lanes; }

    double at(int side, int j, double q) const {
        return power(side, 0)[j] + q * (power(side, 1)[j] + q * power(side, 2)[j]);
    }

    double airy(double q) const { return airy_ + airy_slope_ * q; }

    // Range of the vergences at which single blurs are approximately 0; fill_parabolas stores them in z and slope.
    Range range(double margin) const {
        return range_of(w_.z, w_.slope, w_.lanes, margin, lens_.table().minimum, lens_.table().maximum);
    }

    MaxArea max_area(double v) const {
        const double q = lens_.defocus(v), disc = airy(q), floor = 1 + disc * disc;
        const double* OMNIMIRROR_RESTRICT p = w_.parabolas;
        const double* OMNIMIRROR_RESTRICT counts = w_.density;
        const int n = w_.lanes;
        const auto parabola = [p, n, q](int side, int j) {
            const double* c = p + 3 * side * n + j;
            return c[0] + q * (c[n] + q * c[2 * n]);
        };
        RunningMax maximum;
        for (int k = 0; k < n; k += LANE) {
            OMNIMIRROR_LANES(j, k) {
                const double t = parabola(T, j), u = parabola(S, j), own_t = parabola(OWN_T, j), own_s = parabola(OWN_S, j);
                const double scale = parabola(DH_OF, j) * parabola(DW_OF, j);
                const double sides = (t * t + own_t * own_t + floor) * (u * u + own_s * own_s + floor);
                maximum.update(j - k, k, sides / (scale * scale) * counts[j]);
            }
        }
        const int j = maximum.index();
        const double dfloor = 2 * disc * airy_slope_, scale = at(DH_OF, j, q) * at(DW_OF, j, q);
        const double side_t = side(T, j, q, floor), side_s = side(S, j, q, floor);
        const double value = side_t * side_s / (scale * scale) * counts[j];
        const double d = (side_rate(T, j, q) + dfloor) / side_t + (side_rate(S, j, q) + dfloor) / side_s -
                         2 * (rate(DH_OF, j, q) / at(DH_OF, j, q) + rate(DW_OF, j, q) / at(DW_OF, j, q));
        return {value, value * d * lens_.defocus_rate(v), j};
    }

    // Sum of blur, the lens's own blur and floor, px^2.
    double side(int of, int j, double q, double floor) const {
        const double blur = at(of, j, q), own = at(of + 2, j, q);
        return blur * blur + own * own + floor;
    }

  private:
    double rate(int side, int j, double q) const { return power(side, 1)[j] + 2 * q * power(side, 2)[j]; }

    double side_rate(int of, int j, double q) const {
        return 2 * (at(of, j, q) * rate(of, j, q) + at(of + 2, j, q) * rate(of + 2, j, q));
    }

    Lens lens_;
    double airy_, airy_slope_;
    const Workspace& w_;
};

// A vergence, and the worst area there.
struct End {
    double v;
    MaxArea max_area;
};

// Minimise the worst area, which decreases at a and increases at b, to within `close`. The bracket is divided where the
// tangents at both ends intersect or, if the same angle is the worst at both ends, at the zero of the secant of its
// derivative.
template <class Areas>
double minimise(End a, End b, double tolerance, const FocusSearch& search, const Areas& areas) {
    for (int step = 1; step <= search.max_bracket_steps && b.v - a.v > tolerance; ++step) {
        const double width = b.v - a.v, min_bracket_reduction = search.min_bracket_reduction * width,
                     fall = a.max_area.rate, slope_basis = b.max_area.rate;
        const double cut =
            a.max_area.angle == b.max_area.angle
                ? a.v - fall * width / (slope_basis - fall)
                : a.v + (b.max_area.value - a.max_area.value - slope_basis * width) / (fall - slope_basis);
        const bool good = abs_of(cut) < UNBOUNDED && fall < 0 && slope_basis > 0 && step % search.bisection_period;
        const double c =
            good ? min_of(max_of(cut, a.v + min_bracket_reduction), b.v - min_bracket_reduction) : (a.v + b.v) / 2;
        const End at_c{c, areas.max_area(c)};
        (at_c.max_area.rate > 0 ? b : a) = at_c;
    }
    return (a.v + b.v) / 2;
}

// Minimise the worst area between two scan positions whose tangents indicate another local minimum: _other_valleys.
// `known` is the local minimum at position `best`, which is already computed.
template <class Areas>
End other_minimum(const End& a, const End& b, bool is_known, double known, double tolerance, const FocusSearch& search,
                  const Areas& areas) {
    const End none{a.v, {UNBOUNDED, 0.0, 0}};
    const double fall = a.max_area.rate, slope_basis = b.max_area.rate, step = b.v - a.v;
    const double cut = (b.max_area.value - a.max_area.value - slope_basis * step) / (fall - slope_basis);
    if (!(cut > 0 && cut < step && a.max_area.value + fall * cut < known * (1 + TANGENT_MARGIN))) return none;
    const bool between = fall < 0 && slope_basis > 0,
               hidden = a.max_area.angle != b.max_area.angle && fall * slope_basis > 0;
    if (!(between || hidden) || (between && is_known)) return none;
    const End middle{a.v + cut, areas.max_area(a.v + cut)};
    const double v = middle.max_area.rate > 0 ? minimise(a, middle, tolerance, search, areas)
                                              : minimise(middle, b, tolerance, search, areas);
    return {v, areas.max_area(v)};
}

// Return the focused vergence with the smallest worst area, and that area.
template <class Areas>
End best_vergence(const FocusSearch& search, const Areas& areas) {
    const auto [low, high] = areas.range(search.margin);
    const double step = (high - low) / (search.scan - 1);
    End samples[MAX_SCAN_SAMPLES];
    int best = 0;
    for (int i = 0; i < search.scan; ++i) {
        samples[i] = {low + i * step, areas.max_area(low + i * step)};
        if (samples[i].max_area.value < samples[best].max_area.value) best = i;
    }
    best = best < 1 ? 1 : best > search.scan - 2 ? search.scan - 2 : best;
    const double tolerance = search.tolerance * (high - low);
    const double v = minimise(samples[best - 1], samples[best + 1], tolerance, search, areas);
    End minimum{v, areas.max_area(v)};
    const double known = minimum.max_area.value;
    for (int i = 0; i + 1 < search.scan; ++i) {
        const bool is_known = i == best - 1 || i == best;
        const End other = other_minimum(samples[i], samples[i + 1], is_known, known, tolerance, search, areas);
        if (other.max_area.value < minimum.max_area.value) minimum = other;
    }
    return minimum;
}

}  // namespace
}  // namespace omnimirror
