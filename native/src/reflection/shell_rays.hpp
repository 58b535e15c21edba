// Rays through shells, with plain numbers or with numbers that carry two derivatives. Internal linkage.
#pragma once

#include <algorithm>
#include <cmath>

#include "shell_transmission.hpp"

namespace omnimirror {
namespace {

constexpr double MIN_TRANSVERSE =
    1e-9;  // minimum direction component across a tube's axis; below it, it never meets the shell
constexpr double MIN_SQUARE = 1e-18;  // lower bound of squares, so that no division is by 0

// A number and its derivatives with respect to two variables.
struct Dual {
    double v, x = 0.0, y = 0.0;
};

inline double value(double a) { return a; }
inline double value(Dual a) { return a.v; }

inline Dual operator+(Dual a, Dual b) { return {a.v + b.v, a.x + b.x, a.y + b.y}; }
inline Dual operator-(Dual a, Dual b) { return {a.v - b.v, a.x - b.x, a.y - b.y}; }
inline Dual operator-(Dual a) { return {-a.v, -a.x, -a.y}; }
inline Dual operator*(Dual a, Dual b) { return {a.v * b.v, a.x * b.v + a.v * b.x, a.y * b.v + a.v * b.y}; }
inline Dual operator/(Dual a, Dual b) {
    const double q = a.v / b.v, over = 1 / b.v;
    return {q, (a.x - q * b.x) * over, (a.y - q * b.y) * over};
}
inline Dual operator+(Dual a, double b) { return {a.v + b, a.x, a.y}; }
inline Dual operator-(Dual a, double b) { return {a.v - b, a.x, a.y}; }
inline Dual operator+(double a, Dual b) { return b + a; }
inline Dual operator-(double a, Dual b) { return {a - b.v, -b.x, -b.y}; }
inline Dual operator*(double a, Dual b) { return {a * b.v, a * b.x, a * b.y}; }
inline Dual operator/(double a, Dual b) { return Dual{a} / b; }
inline Dual operator/(Dual a, double b) { return {a.v / b, a.x / b, a.y / b}; }

// Square root; 0 for negative arguments.
inline double root(double square) { return std::sqrt(square > 0 ? square : 0.0); }
inline Dual root(Dual square) {
    if (!(square.v > 0)) return {0.0};
    const double r = std::sqrt(square.v), half = 0.5 / r;
    return {r, half * square.x, half * square.y};
}

inline double clamp_min(double a, double floor) { return std::max(a, floor); }
inline Dual clamp_min(Dual a, double floor) { return a.v > floor ? a : Dual{floor}; }

template <class T>
struct Vector {
    T x, y, z;
};

template <class T>
Vector<T> operator+(Vector<T> a, Vector<T> b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class T>
Vector<T> operator-(Vector<T> a, Vector<T> b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <class T, class S>
Vector<T> operator*(S s, Vector<T> a) {
    return {s * a.x, s * a.y, s * a.z};
}
template <class T>
T dot(Vector<T> a, Vector<T> b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <class T>
T length(Vector<T> a) {
    return root(dot(a, a));
}

template <class T>
struct Intersection {
    Vector<T> at, inwards;  // and the unit normal of the surface there
    T path_length;
};

template <class T>
Intersection<T> intersect_plane(Vector<T> p, Vector<T> d, double height) {
    const T path_length = (height - p.z) / d.z;
    return {p + path_length * d, {T{0}, T{0}, T{1}}, path_length};
}

template <class T>
Intersection<T> intersect_cylinder(Vector<T> p, Vector<T> d, double radius) {
    const T a = d.x * d.x + d.y * d.y, b = p.x * d.x + p.y * d.y, c = p.x * p.x + p.y * p.y - radius * radius;
    const T path_length = (root(b * b - a * c) - b) / clamp_min(a, MIN_SQUARE);
    const Vector<T> at = p + path_length * d;
    return {at, {-at.x / radius, -at.y / radius, T{0}}, path_length};
}

template <class T>
Intersection<T> intersect_sphere(Vector<T> p, Vector<T> d, double centre, double radius) {
    const Vector<T> from{p.x, p.y, p.z - centre};
    const T b = dot(from, d), path_length = root(b * b - (dot(from, from) - radius * radius)) - b;
    const Vector<T> at = p + path_length * d;
    return {at, (1 / radius) * Vector<T>{-at.x, -at.y, centre - at.z}, path_length};
}

template <class T>
Intersection<T> intersect(const Shell& shell, int side, Vector<T> p, Vector<T> d) {
    switch (shell.kind) {
        case ShellKind::WINDOW: return intersect_plane(p, d, shell.heights[side]);
        case ShellKind::TUBE: return intersect_cylinder(p, d, shell.radii[side]);
        default: return intersect_sphere(p, d, shell.heights[side], shell.radii[side]);
    }
}

// Direction behind a surface; the index is that before the surface divided by that behind it.
template <class T>
Vector<T> refracted(Vector<T> d, Vector<T> normal, double ratio) {
    const T cosine = -dot(d, normal);
    return ratio * d + (ratio * cosine - root(1 - ratio * ratio * (1 - cosine * cosine))) * normal;
}

template <class T>
bool is_inside(const Shell& shell, Vector<T> p) {
    const double x = value(p.x), y = value(p.y), z = value(p.z);
    if (shell.kind == ShellKind::WINDOW) return z > shell.heights[0];
    if (shell.kind == ShellKind::TUBE) return std::hypot(x, y) <= shell.radii[0];
    const double over = z - shell.heights[0];
    return std::sqrt(x * x + y * y + over * over) <= shell.radii[0];
}

template <class T>
struct ShellExit {
    Vector<T> inner_point, inwards, exit_point, outwards;
    T before, within;  // distances to the inner surface and within the shell
    double cosine_before, cosine_behind;
    bool meets, passes;
};

// Trace a ray through a shell; a ray that misses it continues unchanged.
template <class T>
ShellExit<T> trace_shell(const Shell& shell, Vector<T> p, Vector<T> d) {
    const bool inside = is_inside(shell, p);
    bool meets = true;
    if (shell.kind == ShellKind::WINDOW) meets = (value(d.z) < 0) & inside;
    if (shell.kind == ShellKind::TUBE)
        meets = std::sqrt(value(d.x) * value(d.x) + value(d.y) * value(d.y)) > MIN_TRANSVERSE;
    const Intersection<T> first = intersect(shell, 0, p, d);
    const Vector<T> within = refracted(d, first.inwards, 1 / shell.index);
    const Intersection<T> second = intersect(shell, 1, first.at, within);
    const Vector<T> out = refracted(within, second.inwards, shell.index / shell.outside);
    const double before = -value(dot(d, first.inwards)), behind = -value(dot(out, second.inwards));
    const bool is_transmitted = shell.kind == ShellKind::WINDOW ? meets : !meets || (before > 0 && behind > 0);
    if (!meets) return {p, first.inwards, p, d, T{0}, T{0}, before, behind, false, is_transmitted && inside};
    return {first.at,           first.inwards, second.at, out,  first.path_length,
            second.path_length, before,        behind,    true, is_transmitted && inside};
}

}  // namespace
}  // namespace omnimirror
