// Kernels of surfaces.hpp. Compiled once per instruction set; therefore, everything has internal linkage.
//
// The rays of a packet fill vectors; a box or a surface is loaded once and tested against all of them.
#pragma once

#include <cmath>
#include <cstring>
#if defined(__AVX2__)
#include <immintrin.h>
#endif

#include "surfaces.hpp"

namespace omnimirror {
namespace {

#if defined(__AVX512F__)
constexpr int WIDTH = 16;
#elif defined(__AVX2__)
constexpr int WIDTH = 8;
#else
constexpr int WIDTH = 4;
#endif
constexpr int PARTS = PACKET / WIDTH;
using Wide = float __attribute__((vector_size(4 * WIDTH)));
using Mask = int32_t __attribute__((vector_size(4 * WIDTH)));
using Four = float __attribute__((vector_size(16)));

constexpr float EDGE_MARGIN = 1e-6f;     // margin relative to a side: surfaces that share an edge leave no gap
constexpr float MIN_COMPONENT = 1e-18f;  // replaces smaller components of a direction, whose inverse would be infinite

inline bool any(Mask mask) {
#if defined(__AVX512F__)
    return _mm512_test_epi32_mask((__m512i)mask, (__m512i)mask) != 0;
#elif defined(__AVX2__)
    return _mm256_movemask_ps((__m256)mask) != 0;
#else
    int64_t halves[2];
    std::memcpy(halves, &mask, sizeof mask);
    return (halves[0] | halves[1]) != 0;
#endif
}

inline Wide min_of(Wide a, Wide b) { return a < b ? a : b; }
inline Wide max_of(Wide a, Wide b) { return a > b ? a : b; }
inline Wide all(float x) { return Wide{} + x; }
inline Wide load(const float* from) {
    Wide x;
    std::memcpy(&x, from, sizeof x);
    return x;
}
template <class T>
void store(T* to, const void* x) {
    std::memcpy(to, x, sizeof(Wide));
}

// Some rays of a packet, and the nearest hit of each.
struct Rays {
    Wide origin[3], direction[3];
    Wide inverse[3], start[3];  // inverse direction; and origin times inverse direction
    Wide distance, a, b;
    Mask surface;
};

Rays rays_of(const Packet& packet, int part) {
    Rays r{};
    for (int c = 0; c < 3; ++c) {
        r.origin[c] = load(packet.origin[c] + WIDTH * part), r.direction[c] = load(packet.direction[c] + WIDTH * part);
        const Wide d = r.direction[c], size = max_of(d, -d);
        r.inverse[c] = 1 / (size < MIN_COMPONENT ? all(MIN_COMPONENT) : d);
        r.start[c] = r.origin[c] * r.inverse[c];
    }
    r.distance = load(packet.limit + WIDTH * part);
    r.surface -= 1;
    return r;
}

// Return whether rays enter a box before their nearest hit so far.
inline Mask enter(const Node& box, const Rays& r) {
    Wide in{}, out = r.distance;
    for (int c = 0; c < 3; ++c) {
        const Wide a = box.low[c] * r.inverse[c] - r.start[c], b = box.high[c] * r.inverse[c] - r.start[c];
        in = max_of(min_of(a, b), in), out = min_of(max_of(a, b), out);
    }
    return in <= out;
}

struct Vector3 {
    Wide x, y, z;
};
inline Vector3 cross(const Vector3& a, const Vector3& b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline Wide dot(const Vector3& a, const Vector3& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
inline Vector3 vector3(const Wide* v) { return {v[0], v[1], v[2]}; }
inline Vector3 vector3(const float* v) { return {all(v[0]), all(v[1]), all(v[2])}; }

// Solve o + t d = corner + a side0 + b side1 with Cramer's rule (Moeller and Trumbore, 1997). The ray hits if a and b
// are in [0, 1], for triangles also a + b <= 1, and t is positive and less than that of the nearest hit so far. Among
// hits at equal distance, the first surface wins, independent of the order of tests.
inline void intersect(const Surface& s, int32_t index, Rays& r) {
    const Vector3 side = vector3(s.side[0]), other = vector3(s.side[1]), direction = vector3(r.direction);
    const Vector3 p = cross(direction, other);
    const Wide inverse = 1 / dot(side, p);  // infinite parallel to the surface, where a and b are out of range
    const Vector3 from = {r.origin[0] - s.corner[0], r.origin[1] - s.corner[1], r.origin[2] - s.corner[2]};
    const Vector3 q = cross(from, side);
    const Wide a = dot(from, p) * inverse, b = dot(direction, q) * inverse, t = dot(other, q) * inverse;
    const Wide end = s.triangle() ? a + b : max_of(a, b);
    const Mask nearer = (t < r.distance) | ((t == r.distance) & (index < r.surface));
    const Mask met = (a >= -EDGE_MARGIN) & (b >= -EDGE_MARGIN) & (end <= 1 + EDGE_MARGIN) & (t > 0) & nearer;
    if (!any(met)) return;
    r.distance = met ? t : r.distance, r.a = met ? a : r.a, r.b = met ? b : r.b;
    r.surface = met ? Mask{} + index : r.surface;
}

void find(const SurfaceTree& tree, Rays (&rays)[PARTS]) {
    bool backwards[3];  // majority of the rays, along each axis
    for (int c = 0; c < 3; ++c) {
        float sum = 0;
        for (const Rays& r : rays)
            for (int i = 0; i < WIDTH; ++i) sum += r.direction[c][i];
        backwards[c] = sum < 0;
    }
    int32_t stack[MAX_TREE_DEPTH + 1];
    int depth = 0;
    stack[depth++] = 0;
    while (depth) {
        const Node& node = tree.nodes[stack[--depth]];
        Mask entered = enter(node, rays[0]);
        for (int part = 1; part < PARTS; ++part) entered |= enter(node, rays[part]);
        if (!any(entered)) continue;
        for (int i = node.first; i < node.first + node.count; ++i)
            for (Rays& r : rays) intersect(tree.surfaces[i], i, r);
        if (node.count) continue;
        const int32_t near = node.first + backwards[node.axis];
        stack[depth++] = 2 * node.first + 1 - near, stack[depth++] = near;
    }
}

inline int wrapped_index(int i, int n) { return i >= 0 && i < n ? i : ((i % n) + n) % n; }
inline float clamped(float x, float low, float high) { return x > low ? (x < high ? x : high) : low; }

// Radiance and transparency at a point of a surface; bilinear between texels.
Four texture_radiance(const SurfaceTree& tree, const Surface& s, float a, float b) {
    const Texture& t = tree.textures[s.texture()];
    float u = s.texel[0] + a * s.texel_side[0][0] + b * s.texel_side[1][0];
    float v = s.texel[1] + a * s.texel_side[0][1] + b * s.texel_side[1][1];
    const float far = 1e9f;  // limit for conversion to int
    u = t.repeats ? clamped(u, -far, far) : clamped(u, 0, static_cast<float>(t.width - 1));
    v = t.repeats ? clamped(v, -far, far) : clamped(v, 0, static_cast<float>(t.height - 1));
    const float left = std::floor(u), top = std::floor(v), fu = u - left, fv = v - top;
    int x0 = static_cast<int>(left), y0 = static_cast<int>(top), x1 = x0 + 1, y1 = y0 + 1;
    if (t.repeats) {
        x0 = wrapped_index(x0, t.width), x1 = wrapped_index(x1, t.width), y0 = wrapped_index(y0, t.height),
        y1 = wrapped_index(y1, t.height);
    } else {
        x1 = x1 < t.width ? x1 : x0, y1 = y1 < t.height ? y1 : y0;
    }
    const auto texel = [&](int x, int y) {
        Four value;
        std::memcpy(&value, tree.texels + 4 * (t.first + int64_t{y} * t.width + x), sizeof value);
        return value;
    };
    const float w11 = fu * fv, w01 = fu - w11, w10 = fv - w11, w00 = 1 - fu - w10;
    return w00 * texel(x0, y0) + w01 * texel(x1, y0) + w10 * texel(x0, y1) + w11 * texel(x1, y1);
}

void trace(const SurfaceTree& tree, const Packet& packet, Hits& hits) {
    Rays rays[PARTS];
    for (int part = 0; part < PARTS; ++part) rays[part] = rays_of(packet, part);
    if (tree.nodes) find(tree, rays);
    for (int part = 0; part < PARTS; ++part) {
        store(hits.distance + WIDTH * part, &rays[part].distance), store(hits.surface + WIDTH * part, &rays[part].surface);
        store(hits.a + WIDTH * part, &rays[part].a), store(hits.b + WIDTH * part, &rays[part].b);
    }
    for (int i = 0; i < PACKET; ++i) {
        const int32_t surface = hits.surface[i];
        const Four light = surface < 0 ? Four{} : texture_radiance(tree, tree.surfaces[surface], hits.a[i], hits.b[i]);
        std::memcpy(hits.light[i], &light, sizeof light);
    }
}

}  // namespace
}  // namespace omnimirror
