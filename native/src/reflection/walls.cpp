#include "walls.hpp"

#include <algorithm>
#include <cmath>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr long RAYS_A_PIECE = 4096;
constexpr double ALONG = 1e-9;    // of a direction across a tube's axis, below which it never comes to the wall
constexpr double TINY = 1e-18;    // squares of these, so that nothing is divided by 0

struct Vector {
    double x, y, z;
};

Vector operator+(Vector a, Vector b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
Vector operator-(Vector a, Vector b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
Vector operator*(double s, Vector a) { return {s * a.x, s * a.y, s * a.z}; }
double dot(Vector a, Vector b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
double root(double square) { return std::sqrt(square > 0 ? square : 0.0); }

Vector of(const double* row) { return {row[0], row[1], row[2]}; }
void put(double* row, Vector v) { row[0] = v.x, row[1] = v.y, row[2] = v.z; }

struct Meeting {
    Vector at, inwards;  // and the side's unit normal there
    double way;
};

Meeting meet_plane(Vector p, Vector d, double height) {
    const double way = (height - p.z) / d.z;
    return {p + way * d, {0, 0, 1}, way};
}

Meeting meet_cylinder(Vector p, Vector d, double radius) {
    const double a = d.x * d.x + d.y * d.y, b = p.x * d.x + p.y * d.y, c = p.x * p.x + p.y * p.y - radius * radius;
    const double way = (root(b * b - a * c) - b) / std::max(a, TINY);
    const Vector at = p + way * d;
    return {at, {-at.x / radius, -at.y / radius, 0}, way};
}

Meeting meet_sphere(Vector p, Vector d, double centre, double radius) {
    const Vector from = p - Vector{0, 0, centre};
    const double b = dot(from, d), way = root(b * b - (dot(from, from) - radius * radius)) - b;
    const Vector at = p + way * d;
    return {at, (1 / radius) * (Vector{0, 0, centre} - at), way};
}

Meeting meet(const Wall& wall, int side, Vector p, Vector d) {
    switch (wall.kind) {
        case WallKind::WINDOW: return meet_plane(p, d, wall.places[side]);
        case WallKind::TUBE: return meet_cylinder(p, d, wall.radii[side]);
        default: return meet_sphere(p, d, wall.places[side], wall.radii[side]);
    }
}

// Behind a side, with the index before it over the one behind.
Vector bent(Vector d, Vector normal, double ratio) {
    const double cosine = -dot(d, normal);
    return ratio * d + (ratio * cosine - root(1 - ratio * ratio * (1 - cosine * cosine))) * normal;
}

bool starts_inside(const Wall& wall, Vector p) {
    if (wall.kind == WallKind::WINDOW) return p.z > wall.places[0];
    if (wall.kind == WallKind::TUBE) return std::hypot(p.x, p.y) <= wall.radii[0];
    const Vector from = p - Vector{0, 0, wall.places[0]};
    return std::sqrt(dot(from, from)) <= wall.radii[0];
}

void leave_one(const WallJob& job, long i) {
    const Wall& wall = job.wall;
    const Vector p = of(job.points + 3 * i), towards = of(job.directions + 3 * i);
    const double length = std::sqrt(dot(towards, towards));
    const Vector d{towards.x / length, towards.y / length, towards.z / length};
    const bool inside = starts_inside(wall, p);
    bool meets = true;
    if (wall.kind == WallKind::WINDOW) meets = (d.z < 0) & inside;
    if (wall.kind == WallKind::TUBE) meets = std::sqrt(d.x * d.x + d.y * d.y) > ALONG;
    const Meeting first = meet(wall, 0, p, d);
    const Vector within = bent(d, first.inwards, 1 / wall.index);
    const Meeting second = meet(wall, 1, first.at, within);
    const Vector out = bent(within, second.inwards, wall.index / wall.outside);
    const double before = -dot(d, first.inwards), behind = -dot(out, second.inwards);
    put(job.vectors[0] + 3 * i, meets ? second.at : p);
    put(job.vectors[1] + 3 * i, meets ? out : d);
    put(job.vectors[2] + 3 * i, meets ? first.at : p);
    put(job.vectors[3] + 3 * i, d);
    put(job.vectors[4] + 3 * i, first.inwards);
    job.numbers[0][i] = meets ? first.way : 0.0, job.numbers[1][i] = meets ? second.way : 0.0;
    job.numbers[2][i] = before, job.numbers[3][i] = behind;
    const bool goes = wall.kind == WallKind::WINDOW ? meets : !meets || ((before > 0) & (behind > 0));
    job.meets[i] = meets, job.passes[i] = goes & inside;
}

}  // namespace

void leave(const WallJob& job) {
    parallel_for(
        static_cast<int>((job.count + RAYS_A_PIECE - 1) / RAYS_A_PIECE),
        [](void* context, int piece) {
            const WallJob& rays = *static_cast<const WallJob*>(context);
            const long first = piece * RAYS_A_PIECE, end = std::min(rays.count, first + RAYS_A_PIECE);
            for (long i = first; i < end; ++i) leave_one(rays, i);
        },
        const_cast<WallJob*>(&job));
}

}  // namespace omnimirror
