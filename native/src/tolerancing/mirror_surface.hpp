// Sag of a mirror with form errors over (x, y), as in perturbed_states.py. Everything has internal linkage.
#pragma once

#include "lanes.hpp"
#include "trials.hpp"

namespace omnimirror {
namespace {

struct Heights {
    double z, gx, gy, hxx, hxy, hyy;
};

// A meridian over s = r^2, with its derivatives with respect to s.
struct Profile {
    double value, first, second;
};

// Conic and polynomial; either may be absent.
template <bool IS_CONIC, int TERMS>
struct Formula {
    double curvature, bend, unit;  // c, (1 + k) c^2, 1 / N^2
    double terms[TERMS > 0 ? TERMS : 1];

    Formula(const TrialJob& job, const double* numbers)
        : curvature(numbers[CURVATURE]),
          bend((1 + numbers[CONIC]) * curvature * curvature),
          unit(1 / (job.rim * job.rim)) {
        for (int i = 0; i < TERMS; ++i) terms[i] = numbers[TRIAL_NUMBERS + i];
    }

    Profile at(double s) const {
        Profile p{0, 0, 0};
        if constexpr (IS_CONIC) {
            const double root = sqrt_of(1 - bend * s), inverse = 1 / root;
            p = {curvature * s / (1 + root), curvature * inverse / 2,
                 bend * curvature * inverse * inverse * inverse / 4};
        }
        if constexpr (TERMS > 0) {
            const double u = s * unit;
            double value = terms[TERMS - 1], first = 0, second = 0;
#pragma GCC unroll 16
            for (int i = TERMS - 2; i >= 0; --i)
                second = second * u + first, first = first * u + value, value = value * u + terms[i];
            second = second * u + first, first = first * u + value, value = value * u;
            p = {p.value + value, p.first + first * unit, p.second + 2 * second * unit * unit};
        }
        return p;
    }
};

struct Table {
    const double* pieces;
    double last, inverse_step, min_radius;

    Table(const TrialJob& job, const double*)
        : pieces(job.table.coefficients),
          last(job.table.pieces - 1),
          inverse_step(1 / job.table.step),
          min_radius(1e-9 * job.rim) {}

    Profile at(double s) const {
        const double r = max_of(sqrt_of(s), min_radius), q = r * inverse_step;
        const int piece = static_cast<int>(min_of(q, last));  // NaN is assigned to the last piece
        const double t = q - piece, *a = pieces + 6 * piece;
        double z = a[5], slope = 0, bend = 0;
#pragma GCC unroll 8
        for (int i = 4; i >= 0; --i) bend = bend * t + slope, slope = slope * t + z, z = z * t + a[i];
        slope *= inverse_step, bend *= 2 * inverse_step * inverse_step;
        const double over = 1 / r;
        return {z, slope * over / 2, (bend - slope * over) * over * over / 4};
    }
};

// Form error as a polynomial of limited order in x and y, by Horner's method in y with polynomials in x as
// coefficients.
template <int ORDER>
struct Form {
    double unit;
    double powers[(ORDER + 1) * (ORDER + 2) / 2];

    Form(const TrialJob& job, const double* numbers) : unit(1 / job.rim) {
        for (int i = 0; i < (ORDER + 1) * (ORDER + 2) / 2; ++i) powers[i] = numbers[TRIAL_NUMBERS + job.terms + i];
    }

    template <int J>
    void add(double u, double v, Heights& sum) const {
        double q = 0, dq = 0, ddq = 0;
#pragma GCC unroll 8
        for (int i = ORDER - J; i >= 0; --i)
            ddq = ddq * u + dq, dq = dq * u + q, q = q * u + powers[(i + J) * (i + J + 1) / 2 + J];
        sum.hyy = sum.hyy * v + sum.gy, sum.gy = sum.gy * v + sum.z, sum.z = sum.z * v + q;
        sum.hxy = sum.hxy * v + sum.gx, sum.gx = sum.gx * v + dq;
        sum.hxx = sum.hxx * v + ddq;
        if constexpr (J > 0) add<J - 1>(u, v, sum);
    }

    Heights at(double x, double y) const {
        Heights sum{0, 0, 0, 0, 0, 0};
        add<ORDER>(x * unit, y * unit, sum);
        const double square = unit * unit;
        return {sum.z, sum.gx * unit, sum.gy * unit, 2 * sum.hxx * square, sum.hxy * square, 2 * sum.hyy * square};
    }
};

// No form error: a constant, which only shifts the mirror.
template <>
struct Form<0> {
    double height;
    Form(const TrialJob& job, const double* numbers) : height(numbers[TRIAL_NUMBERS + job.terms]) {}
    Heights at(double, double) const { return {height, 0, 0, 0, 0, 0}; }
};

template <class Shape, int ORDER>
struct Surface {
    Shape shape;
    Form<ORDER> form;

    Surface(const TrialJob& job, const double* numbers) : shape(job, numbers), form(job, numbers) {}

    Heights at(double x, double y) const {
        const Profile p = shape.at(x * x + y * y);
        const Heights f = form.at(x, y);
        const double first = 2 * p.first, second = 4 * p.second;
        return {p.value + f.z,          x * first + f.gx,
                y * first + f.gy,       first + x * x * second + f.hxx,
                x * y * second + f.hxy, first + y * y * second + f.hyy};
    }
};

}  // namespace
}  // namespace omnimirror
