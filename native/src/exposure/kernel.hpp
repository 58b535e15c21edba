// Ray tracing for exposure.hpp, from the image sensor into the scene. Compiled once per instruction set; therefore,
// everything has internal linkage.
//
// Rays are processed in blocks: each step is a branch-free loop over the lanes of a block, which compilers vectorise.
#pragma once

#include <cmath>

#include "exposure.hpp"

namespace omnimirror {
namespace {

constexpr int LANES = BLOCK;
using Lane = float[LANES];

#if defined(__GNUC__) && !defined(__clang__)
#define OMNIMIRROR_SOME_LANES(i, begin, end) _Pragma("GCC ivdep") for (int i = begin; i < end; ++i)
#else
#define OMNIMIRROR_SOME_LANES(i, begin, end) for (int i = begin; i < end; ++i)
#endif
#define OMNIMIRROR_EACH_LANE(i) OMNIMIRROR_SOME_LANES(i, 0, LANES)

struct alignas(64) Bundle {
    Lane u, v, a, b;                 // pixel, and position on the aperture in [0, 1)
    Lane tx, ty;                     // tangents of the pixel
    Lane ox, oy, oz, dx, dy, dz;     // the ray: in the camera frame, then the mirror frame, then the camera frame again
    Lane px, py, pz, nx, ny;         // intersection with the mirror, and the normal (nx, ny, 1)
    Lane weight;
    float fate[LANES];  // stored as float, so that all lanes have one width
};

inline float positive(float x) { return x > 0 ? x : 0; }
inline float absolute(float x) { return x < 0 ? -x : x; }
inline float root(float x) { return __builtin_sqrtf(positive(x)); }
inline float floor_of(float x) { return __builtin_floorf(x); }

// atan2 in radians, with an error of 3e-7.
inline float angle_of(float y, float x) {
    const float ax = absolute(x), ay = absolute(y);
    const float low = ax < ay ? ax : ay, high = ax < ay ? ay : ax;
    const float t = low / (high + 1e-30f), s = t * t;
    float a = 0.00681177105f;
    a = a * s - 0.0336041491f, a = a * s + 0.0796235844f, a = a * s - 0.132333369f;
    a = a * s + 0.198078141f, a = a * s - 0.333173679f, a = (a * s + 0.999996111f) * t;
    a = ay > ax ? 1.57079633f - a : a;
    a = x < 0 ? 3.14159265f - a : a;
    return y < 0 ? -a : a;
}

// sin and cos of t turns, t in [-0.5, 0.5], with an error of 3e-7.
inline float sine_of(float t) {
    const float s = t * t;
    float a = -12.3700726f;
    a = a * s + 41.268481f, a = a * s - 76.5946177f, a = a * s + 81.5976293f;
    return ((a * s - 41.3414793f) * s + 6.28318346f) * t;
}
inline float cosine_of(float t) {
    const float s = t * t;
    float a = 6.5744248f;
    a = a * s - 25.9997443f, a = a * s + 60.1760386f, a = a * s - 85.4511445f, a = a * s + 64.9391712f;
    return (a * s - 19.7392055f) * s + 0.999999992f;
}

inline uint32_t hash(uint32_t h) {  // 32-bit hash finaliser with full avalanche (Wellons, "lowbias32")
    h ^= h >> 16, h *= 0x7feb352du, h ^= h >> 15, h *= 0x846ca68bu, h ^= h >> 16;
    return h;
}

// Pseudo-random shift in [0, 1) per pixel and dimension.
struct Shifts {
    float of[4];
};

inline Shifts shifts_of(const Samples& samples, int column, int row) {
    Shifts shifts{{0, 0, 0, 0}};
    if (!samples.shifted) return shifts;
    uint32_t h = hash(samples.seed ^ hash(static_cast<uint32_t>(column) + hash(static_cast<uint32_t>(row))));
    for (float& shift : shifts.of) shift = static_cast<float>(h >> 8) * 0x1p-24f, h = hash(h + 0x9e3779b9u);
    return shifts;
}

// Return the integer part of x if it is between 0 and `last`, otherwise 0: an index that is always valid. The
// comparison uses the integer, shielded from the assumptions of -ffast-math: NaN converts to the minimum integer or to
// 0.
inline int index_of(float x, int last) {
    int whole = static_cast<int>(x);
    asm("" : "+r"(whole));
    return static_cast<unsigned>(whole) <= static_cast<unsigned>(last) ? whole : 0;
}

inline float wrapped(float x) { return x - (x >= 1 ? 1.f : 0.f); }

// -- the steps of a ray ----------------------------------------------------------------------------
//
// Compilers vectorise loops in which no load depends on a lane. Optics are therefore passed by value: values in another
// object's memory could be loaded only under the branch that uses them.

// Place the samples of the lanes, starting with number `first` of the row, pixel by pixel.
void place_samples(const Exposure& e, int row, int64_t first, Bundle& r) {
    const Samples& s = e.samples;
    int column = e.left + static_cast<int>(first / s.count), sample = static_cast<int>(first % s.count);
    for (int begin = 0, end; begin < LANES; begin = end, sample = 0, ++column) {
        end = LANES - begin < s.count - sample ? LANES : begin + s.count - sample;
        const Shifts shifts = shifts_of(s, column, row);
        const float across = shifts.of[0], down = shifts.of[1], out = shifts.of[2], about = shifts.of[3];
        const float left = static_cast<float>(column), top = static_cast<float>(row);
        OMNIMIRROR_SOME_LANES(i, begin, end) {
            const float* p = s.points + 4 * (sample + i - begin);
            r.u[i] = left + wrapped(p[0] + across) - 0.5f, r.v[i] = top + wrapped(p[1] + down) - 0.5f;
            r.a[i] = wrapped(p[2] + out), r.b[i] = wrapped(p[3] + about);
        }
    }
}

// Remove the lens distortion from tangents, and store its change of area as weight: Newton's method, first along the
// radius, bounded by the fold, then in both coordinates. Tangents without a solution are set far outside, with weight
// 0.
void undistort(const Optics o, Bundle& r) {
    const float k1 = o.distortion[0], k2 = o.distortion[1], k3 = o.distortion[2];
    const float p1 = o.distortion[3], p2 = o.distortion[4];
    OMNIMIRROR_EACH_LANE(i) {
        const float distorted_x = r.tx[i], distorted_y = r.ty[i],
                    distorted_radius = root(distorted_x * distorted_x + distorted_y * distorted_y);
        float radius = distorted_radius < o.fold ? distorted_radius : o.fold;
        for (int step = 0; step < 8; ++step) {
            const float s = radius * radius, bend = 1 + s * (k1 + s * (k2 + s * k3));
            const float rate = 1 + s * (3 * k1 + s * (5 * k2 + s * 7 * k3));
            radius -= (radius * bend - distorted_radius) / (rate > 0.01f ? rate : 0.01f);
            radius = radius < o.fold ? positive(radius) : o.fold;
        }
        const float inwards = radius / (distorted_radius + 1e-30f);
        float x = distorted_x * inwards, y = distorted_y * inwards, left_x = 0, left_y = 0, area = 1;
        for (int step = 0; step < 3; ++step) {
            const float s = x * x + y * y, bend = 1 + s * (k1 + s * (k2 + s * k3)), turn = k1 + s * (2 * k2 + s * 3 * k3);
            left_x = x * bend + 2 * p1 * x * y + p2 * (s + 2 * x * x) - distorted_x;
            left_y = y * bend + p1 * (s + 2 * y * y) + 2 * p2 * x * y - distorted_y;
            const float xx = bend + 2 * x * x * turn + 2 * p1 * y + 6 * p2 * x, xy = 2 * (x * y * turn + p1 * x + p2 * y);
            const float yy = bend + 2 * y * y * turn + 6 * p1 * y + 2 * p2 * x;
            area = xx * yy - xy * xy;
            const float inverse = 1 / (area > 1e-3f ? area : 1e-3f);
            x -= inverse * (yy * left_x - xy * left_y), y -= inverse * (xx * left_y - xy * left_x);
        }
        const float miss = absolute(left_x) + absolute(left_y);
        const bool converged =
            (miss < 1e-5f * (1 + distorted_radius)) & (x * x + y * y <= o.fold * o.fold) & (area > 0);
        r.tx[i] = converged ? x : 1e3f, r.ty[i] = converged ? y : 1e3f;
        r.weight[i] = converged ? 1 / area : 0;
    }
}

// Trace from the pixel through the aperture towards the point in focus: with the tangents T of the chief ray and a
// position s on the stop, the origin is s and the direction (T focus - s, focus). Natural vignetting is cos^4 of the
// chief ray angle.
void through_lens(const Optics o, Bundle& r) {
    const float perspective = o.telecentric ? 0.f : 1.f;
    OMNIMIRROR_EACH_LANE(i) {
        r.tx[i] = o.scale[0] * (r.u[i] - o.centre[0]), r.ty[i] = o.scale[1] * (r.v[i] - o.centre[1]);
        r.weight[i] = 1;
    }
    const float* d = o.distortion;
    if (d[0] != 0 || d[1] != 0 || d[2] != 0 || d[3] != 0 || d[4] != 0) undistort(o, r);
    OMNIMIRROR_EACH_LANE(i) {
        const float tx = r.tx[i], ty = r.ty[i];
        const float radius = o.stop * root(r.a[i]), turn = r.b[i] - 0.5f;
        const float ax = radius * cosine_of(turn), ay = radius * sine_of(turn);
        // towards (tx, ty, 1) focus from (ax, ay, 0); telecentric: through (tx, ty, focus) with slopes (ax, ay)
        r.ox[i] = perspective * ax + (1 - perspective) * tx;
        r.oy[i] = perspective * ay + (1 - perspective) * ty;
        r.oz[i] = (1 - perspective) * o.focus;
        r.dx[i] = perspective * (o.focus * tx - ax) + (1 - perspective) * ax;
        r.dy[i] = perspective * (o.focus * ty - ay) + (1 - perspective) * ay;
        r.dz[i] = perspective * o.focus + (1 - perspective);
        const float cos2 = 1 / (1 + perspective * (tx * tx + ty * ty));
        r.weight[i] = r.weight[i] > 0 ? 1 - o.natural_vignetting * (1 - cos2 * cos2 * r.weight[i]) : 0;
    }
}

// Transform vectors to axes that are the rows of m.
void turn(const float (&m)[9], Lane& x, Lane& y, Lane& z) {
    const float xx = m[0], xy = m[1], xz = m[2], yx = m[3], yy = m[4], yz = m[5], zx = m[6], zy = m[7], zz = m[8];
    OMNIMIRROR_EACH_LANE(i) {
        const float a = x[i], b = y[i], c = z[i];
        x[i] = xx * a + xy * b + xz * c, y[i] = yx * a + yy * b + yz * c, z[i] = zx * a + zy * b + zz * c;
    }
}

// Transform to the mirror frame, and move origins to the vertex plane, which minimises cancellation.
void to_mirror(const Optics& o, Bundle& r) {
    const float tx = o.vertex[0], ty = o.vertex[1], tz = o.vertex[2];
    OMNIMIRROR_EACH_LANE(i) r.ox[i] -= tx, r.oy[i] -= ty, r.oz[i] -= tz;
    if (!o.aligned) turn(o.axes, r.ox, r.oy, r.oz), turn(o.axes, r.dx, r.dy, r.dz);
    OMNIMIRROR_EACH_LANE(i) {
        const float s = -r.oz[i] / r.dz[i];
        r.ox[i] += s * r.dx[i], r.oy[i] += s * r.dy[i];
    }
}

// Intersect the ray from the lens with the conic's sheet at the vertex: the root of
//   c (x^2 + y^2 + (1 + k) z^2) = 2 z, c the curvature, k the conic constant,
// that is 0 at the vertex; t is measured from the vertex plane.
void intersect_conic(const Optics o, Bundle& r) {
    const float c = o.curvature, k1 = 1 + o.conic;
    OMNIMIRROR_EACH_LANE(i) {
        const float x = r.ox[i], y = r.oy[i], dx = r.dx[i], dy = r.dy[i], dz = r.dz[i];
        const float b = dz - c * (x * dx + y * dy), cc = c * (x * x + y * y);
        const float disc = b * b - c * (dx * dx + dy * dy + k1 * dz * dz) * cc;
        const float t = cc / (b + root(disc));
        const float px = x + t * dx, py = y + t * dy, pz = t * dz, steep = 1 / (1 - k1 * c * pz);
        r.px[i] = px, r.py[i] = py, r.pz[i] = pz;
        r.nx[i] = -c * px * steep, r.ny[i] = -c * py * steep;
        r.fate[i] = (disc >= 0) & (b > 0) & (px * px + py * py <= o.rim * o.rim) ? REFLECTED : LOST;
    }
}

// The meridian within h of a radius r0: the slope is a polynomial of t = (r - r0)/h, and the sag its integral. On such
// a short interval, this approximates any smooth mirror, and lanes require no table lookups.
struct Piece {
    float r0, h, sag, slope[6];
};

// Hermite interpolation between two nodes: value and derivative at t in [0, 1], from values and derivatives at the
// nodes.
struct HermiteValue {
    float value, rate;
};
inline HermiteValue hermite(float f0, float g0, float f1, float g1, float t) {
    const float d = f1 - f0, a = 3 * d - 2 * g0 - g1, b = g0 + g1 - 2 * d;
    return {f0 + t * (g0 + t * (a + t * b)), g0 + t * (2 * a + 3 * b * t)};
}

inline const MeridianNode* node_before(const Optics& o, float r, float& t) {
    const float position = r / o.step, last = static_cast<float>(o.cells) - 1;
    const float cell = position < last ? floor_of(position) : last;
    t = position - cell;
    return o.nodes + index_of(cell, o.cells - 1);
}

inline HermiteValue slope_at(const Optics& o, float r) {
    float t;
    const MeridianNode* n = node_before(o, r, t);
    const HermiteValue s = hermite(n[0].slope, n[0].curvature * o.step, n[1].slope, n[1].curvature * o.step, t);
    return {s.value, s.rate / o.step};
}

inline float sag_at(const Optics& o, float r) {
    float t;
    const MeridianNode* n = node_before(o, r, t);
    return hermite(n[0].sag, n[0].slope * o.step, n[1].sag, n[1].slope * o.step, t).value;
}

Piece meridian_piece(const Optics& o, float low, float high) {
    const float r0 = 0.5f * (low + high), h = 0.5f * (high - low);
    const HermiteValue a = slope_at(o, low), m = slope_at(o, r0), b = slope_at(o, high);
    const float even = 0.5f * (b.value + a.value) - m.value, odd = 0.5f * (b.value - a.value) - h * m.rate;
    const float even_rate = 0.5f * h * (b.rate - a.rate), odd_rate = 0.5f * h * (b.rate + a.rate) - h * m.rate;
    const float a4 = 0.5f * even_rate - even, a5 = 0.5f * (odd_rate - 3 * odd);
    return {r0, h, sag_at(o, r0), {m.value, h * m.rate, even - a4, odd - a5, a4, a5}};
}

// The piece below all lanes that are near the mirror, with a margin.
Piece covering_piece(const Optics& o, const Bundle& r) {
    float low = o.rim, high = 0;
    for (int i = 0; i < LANES; ++i) {
        const float distance = root(r.px[i] * r.px[i] + r.py[i] * r.py[i]), inside = distance < o.rim ? distance : o.rim;
        low = inside < low ? inside : low, high = inside > high ? inside : high;
    }
    const float margin = 0.002f * o.rim + 0.2f * (high - low);
    low = positive(low - margin), high = high + margin < o.rim ? high + margin : o.rim;
    return meridian_piece(o, low, high);
}

struct NewtonProgress {
    float max_step;  // maximum step, mm
    float left;   // maximum distance of a lane outside the piece, mm
};

// One Newton step from the points at px, py, pz; beyond the rim, the surface is extrapolated linearly.
NewtonProgress newton_step(const Optics& o, const Piece& piece, Bundle& r) {
    const float* s = piece.slope;
    const float inverse = 1 / piece.h;
    Lane max_step, left;
    OMNIMIRROR_EACH_LANE(i) {
        const float x = r.px[i], y = r.py[i], distance = root(x * x + y * y);
        const float on = distance < o.rim ? distance : o.rim, t = (on - piece.r0) * inverse;
        const float slope = s[0] + t * (s[1] + t * (s[2] + t * (s[3] + t * (s[4] + t * s[5]))));
        const float mean = s[0] + t * (s[1] * 0.5f + t * (s[2] * (1.f / 3) + t * (s[3] * 0.25f +
                           t * (s[4] * 0.2f + t * s[5] * (1.f / 6)))));
        const float sag = piece.sag + (on - piece.r0) * mean + (distance - on) * slope;
        const float outwards = slope / (distance + 1e-20f);
        const float nx = -outwards * x, ny = -outwards * y;
        const float rate = nx * r.dx[i] + ny * r.dy[i] + r.dz[i];  // derivative of z - sag along the ray
        const float step = (sag - r.pz[i]) / rate;
        const bool hit = (rate > 0) & (distance <= o.rim);
        r.px[i] = x + step * r.dx[i], r.py[i] = y + step * r.dy[i], r.pz[i] += step * r.dz[i];
        r.nx[i] = nx, r.ny[i] = ny;
        r.fate[i] = hit ? REFLECTED : LOST;
        max_step[i] = hit ? absolute(step * r.dz[i]) : 0;
        left[i] = hit ? absolute(on - piece.r0) - piece.h : 0;
    }
    NewtonProgress progress{0, 0};
    OMNIMIRROR_EACH_LANE(i) progress.max_step = max_step[i] > progress.max_step ? max_step[i] : progress.max_step;
    OMNIMIRROR_EACH_LANE(i) progress.left = left[i] > progress.left ? left[i] : progress.left;
    return progress;
}

constexpr float TOLERANCE_MM = 5e-5f;  // changes the normal by 1e-6
constexpr int MAX_STEPS = 16;          // only rays that graze the rim need more than a few

// Intersect a meridian given by nodes, starting from the best-fit conic.
void intersect_nodes(const Optics o, Bundle& r) {
    intersect_conic(o, r);
    OMNIMIRROR_EACH_LANE(i) {  // the ray may miss the conic but hit the mirror
        const bool usable = r.px[i] * r.px[i] + r.py[i] * r.py[i] < 2 * o.rim * o.rim;
        r.px[i] = usable ? r.px[i] : r.ox[i], r.py[i] = usable ? r.py[i] : r.oy[i], r.pz[i] = usable ? r.pz[i] : 0;
    }
    Piece piece = covering_piece(o, r);
    for (int k = 0; k < MAX_STEPS; ++k) {
        const NewtonProgress progress = newton_step(o, piece, r);
        if (progress.left > 0)
            piece = covering_piece(o, r);
        else if (progress.max_step <= TOLERANCE_MM)
            return;
    }
}

// Reflect at the mirror, and transform back to the camera frame; rays that missed continue straight. Reflected rays
// that pass above the rim may hit the dark edge around it.
void reflect(const Optics o, Bundle& r) {
    const float* w = o.reflectance;
    OMNIMIRROR_EACH_LANE(i) {
        const bool hit = r.fate[i] == REFLECTED;
        const float px = r.px[i], py = r.py[i], pz = r.pz[i], ox = r.ox[i], oy = r.oy[i];
        float x = hit ? px : ox, y = hit ? py : oy, z = hit ? pz : 0;
        float dx = r.dx[i], dy = r.dy[i], dz = r.dz[i];
        const float nx = r.nx[i], ny = r.ny[i], n2 = 1 + nx * nx + ny * ny;
        const float along = dx * nx + dy * ny + dz;
        const float reflection_scale = hit ? 2 * along / n2 : 0;
        const float d2 = dx * dx + dy * dy + dz * dz;
        const float oblique = 1 - absolute(along) / root(n2 * d2);
        dx -= reflection_scale * nx, dy -= reflection_scale * ny, dz -= reflection_scale;
        float reflectance = w[7];
        for (int k = 6; k >= 0; --k) reflectance = reflectance * oblique + w[k];
        r.weight[i] *= hit ? reflectance : 1;
        const float up = (o.edge_z - z) / (dz + 1e-30f), ex = x + up * dx, ey = y + up * dy, e2 = ex * ex + ey * ey;
        const bool edge = hit & (up > 0) & (e2 > o.rim * o.rim) & (e2 < o.edge_radius * o.edge_radius);
        r.fate[i] = edge ? OBSCURED : r.fate[i];
        r.px[i] = x, r.py[i] = y, r.pz[i] = z;
        r.dx[i] = dx, r.dy[i] = dy, r.dz[i] = dz;
    }
    if (!o.aligned) {
        const float* m = o.axes;
        const float back[9] = {m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]};
        turn(back, r.px, r.py, r.pz), turn(back, r.dx, r.dy, r.dz);
    }
    const float tx = o.vertex[0], ty = o.vertex[1], tz = o.vertex[2];
    OMNIMIRROR_EACH_LANE(i) r.px[i] += tx, r.py[i] += ty, r.pz[i] += tz;
}

// Return whether a ray hits one end of the rod.
inline bool hits_rod_end(const Optics& o, int end, float x, float y, float z, float dx, float dy, float dz) {
    const float t = (o.rod_z[end] - z) / (dz + 1e-30f), px = x + t * dx, py = y + t * dy;
    return (t >= 0) & (px * px + py * py < o.rod_radius[end] * o.rod_radius[end]);
}

// Return whether a ray hits the rod at its side or its ends, or starts inside it, which is possible if the mirror is
// misaligned.
inline bool hits_rod(const Optics& o, float x, float y, float z, float dx, float dy, float dz) {
    const float taper = (o.rod_radius[1] - o.rod_radius[0]) / (o.rod_z[1] - o.rod_z[0]);
    const float radius = o.rod_radius[0] + taper * (z - o.rod_z[0]), widening = taper * dz;
    const float a = dx * dx + dy * dy - widening * widening, b = x * dx + y * dy - radius * widening;
    const float c = x * x + y * y - radius * radius, disc = b * b - a * c;
    const float t = (-b - root(disc)) / (a + 1e-20f), at = z + t * dz;
    const bool side = (disc > 0) & (t > 0) & (at >= o.rod_z[0]) & (at <= o.rod_z[1]);
    const bool inside = (c < 0) & (z > o.rod_z[0]) & (z < o.rod_z[1]);
    return side | inside | hits_rod_end(o, 0, x, y, z, dx, dy, dz) | hits_rod_end(o, 1, x, y, z, dx, dy, dz);
}

// Radiance of the camera front; q is the distance from the axis in radii of the lens's front ring: glass with a glint,
// a bright ring, the barrel, a groove, and the body with a mark towards the top of the image.
inline float front_radiance(float x, float y, float q) {
    const float gx = x + 0.2f, gy = y + 0.25f;
    const bool glint = gx * gx + gy * gy < 0.0144f;
    const bool mark = (absolute(x) < 0.12f) & (y < 0) & (q > 1.15f) & (q < 1.55f);
    const float body = mark ? 12.f : q < 2.2f ? 1.f : 0.7f;
    const float glass = glint ? 12.f : q < 0.55f ? 0.25f : 1.f;
    return q < 0.62f ? glass : q < 0.74f ? 6.f : q < 1 ? 1.5f : q < 1.06f ? 0.3f : body;
}

// Dark edge around the mirror rim, in the mirror frame: rays that miss the mirror may hit it.
void intersect_edge(const Optics o, Bundle& r) {
    OMNIMIRROR_EACH_LANE(i) {
        const float t = o.edge_z / r.dz[i], x = r.ox[i] + t * r.dx[i], y = r.oy[i] + t * r.dy[i];
        const bool on = (r.fate[i] == LOST) & (x * x + y * y < o.edge_radius * o.edge_radius) & (r.weight[i] > 0);
        r.fate[i] = on ? OBSCURED : r.fate[i];
    }
}

// Obscuration by the camera and its rod. The rod blocks mirrored rays, and also light between the mirror and the lens:
// each ray is traced back to its position on the stop or, if the lens is telecentric, along its direction.
void obscure(const Optics o, Bundle& r) {
    if (o.rod_z[1] > o.rod_z[0]) {
        const float to_stop = o.telecentric ? 0.f : 1.f, side = o.telecentric ? -1.f : 1.f;
        OMNIMIRROR_EACH_LANE(i) {
            const float x = r.px[i], y = r.py[i], z = r.pz[i];
            const float radius = side * o.stop * root(r.a[i]), position = r.b[i] - 0.5f;
            const float bx = radius * cosine_of(position) - to_stop * x, by = radius * sine_of(position) - to_stop * y;
            const float bz = o.telecentric ? -1.f : -z;
            const bool out = hits_rod(o, x, y, z, r.dx[i], r.dy[i], r.dz[i]);
            const bool back = hits_rod(o, x, y, z, bx, by, bz);
            r.fate[i] = (r.fate[i] != LOST) & (out | back) ? OBSCURED : r.fate[i];
        }
    }
    OMNIMIRROR_EACH_LANE(i) {
        const float down = (o.body_z - r.pz[i]) / (r.dz[i] - 1e-30f);
        const float x = r.px[i] + down * r.dx[i], y = r.py[i] + down * r.dy[i];
        const bool body = (r.dz[i] < 0) & (x * x + y * y < o.body_radius * o.body_radius);
        const bool visible = (r.fate[i] == REFLECTED) & body;
        const float qx = x / o.lens_radius, qy = y / o.lens_radius;
        r.weight[i] *= visible ? front_radiance(qx, qy, root(qx * qx + qy * qy)) : 1;
        r.fate[i] = visible ? OBSCURED : r.fate[i];
    }
}

// Trace all steps; return whether any lane is not lost.
bool trace(const Exposure& e, int row, int64_t first, Bundle& r) {
    const Optics& o = e.optics;
    place_samples(e, row, first, r);
    through_lens(o, r);
    to_mirror(o, r);
    if (o.nodes)
        intersect_nodes(o, r);
    else
        intersect_conic(o, r);
    if (o.edge_radius > o.rim) intersect_edge(o, r);
    float sum = 0;
    OMNIMIRROR_EACH_LANE(i) sum += r.fate[i];
    if (sum == 0 && !o.direct_view) return false;
    reflect(o, r);
    const float missed_fate = o.direct_view ? DIRECT : LOST;
    OMNIMIRROR_EACH_LANE(i) r.fate[i] = r.fate[i] == LOST ? missed_fate : r.fate[i];
    if (o.body_radius > 0 || o.rod_z[1] > o.rod_z[0]) obscure(o, r);
    turn(o.rotation, r.dx, r.dy, r.dz);  // to the world frame
    return true;
}

}  // namespace
}  // namespace omnimirror
