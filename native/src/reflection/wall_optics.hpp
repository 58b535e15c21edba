// Rays through shells, with plain numbers or with numbers that carry two derivatives. Internal linkage.
#pragma once

#include <algorithm>
#include <cmath>

#include "walls.hpp"

namespace omnimirror {
namespace {

constexpr double ALONG = 1e-9;  // minimum direction component across a tube's axis; below it, it never meets the shell
constexpr double TINY = 1e-18;  // lower bound of squares, so that no division is by 0

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

inline double at_least(double a, double least) { return std::max(a, least); }
inline Dual at_least(Dual a, double least) { return a.v > least ? a : Dual{least}; }

template <class T>
struct Vector {
    T x, y, z;
};

template <class T>
Vector<T> operator+(Vector<T> a, Vector<T> b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
template <class T>
Vector<T> operator-(Vector<T> a, Vector<T> b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
template <class T, class S>
Vector<T> operator*(S s, Vector<T> a) { return {s * a.x, s * a.y, s * a.z}; }
template <class T>
T dot(Vector<T> a, Vector<T> b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class T>
T length(Vector<T> a) { return root(dot(a, a)); }

template <class T>
struct Meeting {
    Vector<T> at, inwards;  // and the unit normal of the surface there
    T way;
};

template <class T>
Meeting<T> meet_plane(Vector<T> p, Vector<T> d, double height) {
    const T way = (height - p.z) / d.z;
    return {p + way * d, {T{0}, T{0}, T{1}}, way};
}

template <class T>
Meeting<T> meet_cylinder(Vector<T> p, Vector<T> d, double radius) {
    const T a = d.x * d.x + d.y * d.y, b = p.x * d.x + p.y * d.y, c = p.x * p.x + p.y * p.y - radius * radius;
    const T way = (root(b * b - a * c) - b) / at_least(a, TINY);
    const Vector<T> at = p + way * d;
    return {at, {-at.x / radius, -at.y / radius, T{0}}, way};
}

template <class T>
Meeting<T> meet_sphere(Vector<T> p, Vector<T> d, double centre, double radius) {
    const Vector<T> from{p.x, p.y, p.z - centre};
    const T b = dot(from, d), way = root(b * b - (dot(from, from) - radius * radius)) - b;
    const Vector<T> at = p + way * d;
    return {at, (1 / radius) * Vector<T>{-at.x, -at.y, centre - at.z}, way};
}

template <class T>
Meeting<T> meet(const Wall& wall, int side, Vector<T> p, Vector<T> d) {
    switch (wall.kind) {
        case WallKind::WINDOW: return meet_plane(p, d, wall.places[side]);
        case WallKind::TUBE: return meet_cylinder(p, d, wall.radii[side]);
        default: return meet_sphere(p, d, wall.places[side], wall.radii[side]);
    }
}

// Direction behind a surface; the index is that before the surface divided by that behind it.
template <class T>
Vector<T> bent(Vector<T> d, Vector<T> normal, double ratio) {
    const T cosine = -dot(d, normal);
    return ratio * d + (ratio * cosine - root(1 - ratio * ratio * (1 - cosine * cosine))) * normal;
}

template <class T>
bool starts_inside(const Wall& wall, Vector<T> p) {
    const double x = value(p.x), y = value(p.y), z = value(p.z);
    if (wall.kind == WallKind::WINDOW) return z > wall.places[0];
    if (wall.kind == WallKind::TUBE) return std::hypot(x, y) <= wall.radii[0];
    const double over = z - wall.places[0];
    return std::sqrt(x * x + y * y + over * over) <= wall.radii[0];
}

template <class T>
struct WayOut {
    Vector<T> met, inwards, left_at, outwards;
    T before, within;             // distances to the inner surface and within the shell
    double cosine_before, cosine_behind;
    bool meets, passes;
};

// Trace a ray through a shell; a ray that misses it continues unchanged.
template <class T>
WayOut<T> way_out(const Wall& wall, Vector<T> p, Vector<T> d) {
    const bool inside = starts_inside(wall, p);
    bool meets = true;
    if (wall.kind == WallKind::WINDOW) meets = (value(d.z) < 0) & inside;
    if (wall.kind == WallKind::TUBE) meets = std::sqrt(value(d.x) * value(d.x) + value(d.y) * value(d.y)) > ALONG;
    const Meeting<T> first = meet(wall, 0, p, d);
    const Vector<T> within = bent(d, first.inwards, 1 / wall.index);
    const Meeting<T> second = meet(wall, 1, first.at, within);
    const Vector<T> out = bent(within, second.inwards, wall.index / wall.outside);
    const double before = -value(dot(d, first.inwards)), behind = -value(dot(out, second.inwards));
    const bool goes = wall.kind == WallKind::WINDOW ? meets : !meets || (before > 0 && behind > 0);
    if (!meets) return {p, first.inwards, p, d, T{0}, T{0}, before, behind, false, goes && inside};
    return {first.at, first.inwards, second.at, out, first.way, second.way, before, behind, true, goes && inside};
}

}  // namespace
}  // namespace omnimirror
