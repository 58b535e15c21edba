#include "surfaces.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr float INFINITE = std::numeric_limits<float>::infinity();
constexpr int FEW = 2;            // surfaces are not divided further
constexpr int DEEPEST = 64;       // levels that the search can remember
constexpr int64_t PORTION = 4096;  // rays that a thread takes at a time
constexpr float BESIDE = 1e-6f;    // of a side: neighbours that share an edge leave no gap

Node box_of(const Surface& s) {
    Node box{};
    for (int c = 0; c < 3; ++c) {
        const float p = s.corner[c], a = s.side[0][c], b = s.side[1][c];
        const float far = s.triangle ? p : p + a + b;
        box.low[c] = std::min({p, p + a, p + b, far}), box.high[c] = std::max({p, p + a, p + b, far});
        const float grain = 1e-5f * std::max({1.f, std::fabs(box.low[c]), std::fabs(box.high[c])});
        box.low[c] -= grain, box.high[c] += grain;  // what is flat has a box all the same
    }
    return box;
}

void enclose(Node& box, const Node& other) {
    for (int c = 0; c < 3; ++c)
        box.low[c] = std::min(box.low[c], other.low[c]), box.high[c] = std::max(box.high[c], other.high[c]);
}

// Where the ray enters a box, or infinity.
float entry(const Node& box, const float* origin, const float* inverse, float nearest) {
    float in = 0, out = nearest;
    for (int c = 0; c < 3; ++c) {
        const float a = (box.low[c] - origin[c]) * inverse[c], b = (box.high[c] - origin[c]) * inverse[c];
        in = std::max(in, std::min(a, b)), out = std::min(out, std::max(a, b));
    }
    return in <= out ? in : INFINITE;
}

void cross(const float* a, const float* b, float* out) {
    out[0] = a[1] * b[2] - a[2] * b[1], out[1] = a[2] * b[0] - a[0] * b[2], out[2] = a[0] * b[1] - a[1] * b[0];
}
float dot(const float* a, const float* b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

// Where o + t d = corner + a side0 + b side1, by Cramer's rule (Moeller and Trumbore, 1997); met where a and b are in
// [0, 1], of a triangle a + b <= 1 too, and t is above 0 and below what was met before.
void meet(const Surface& s, int32_t index, const Ray& ray, Hit& hit) {
    float p[3], q[3], from[3];
    cross(ray.direction, s.side[1], p);
    const float det = dot(s.side[0], p);
    if (det == 0) return;
    for (int c = 0; c < 3; ++c) from[c] = ray.origin[c] - s.corner[c];
    cross(from, s.side[0], q);
    const float a = dot(from, p) / det, b = dot(ray.direction, q) / det, t = dot(s.side[1], q) / det;
    const bool on = a >= -BESIDE && b >= -BESIDE && (s.triangle ? a + b <= 1 + BESIDE : a <= 1 + BESIDE && b <= 1 + BESIDE);
    if (on && t > 0 && t < hit.distance) hit = {t, index, a, b};
}

int around(int i, int n) { return ((i % n) + n) % n; }

struct Work {
    const Surfaces& surfaces;
    const float *origins, *directions;
    int64_t count;
    float *light, *distances;
};

void look(void* context, int portion) {
    const Work& w = *static_cast<const Work*>(context);
    const int64_t end = std::min(w.count, PORTION * (portion + int64_t{1}));
    for (int64_t i = PORTION * portion; i < end; ++i) {
        const float *o = w.origins + 3 * i, *d = w.directions + 3 * i;
        const Hit hit = w.surfaces.first_hit({{o[0], o[1], o[2]}, {d[0], d[1], d[2]}});
        w.distances[i] = hit.distance;
        w.surfaces.look_up(hit, w.light + 4 * i);
    }
}

}  // namespace

Surfaces::Surfaces(std::vector<Surface> surfaces, std::vector<Texture> textures, std::vector<float> texels)
    : textures_(std::move(textures)), texels_(std::move(texels)) {
    std::vector<Node> boxes;
    for (const Surface& s : surfaces) boxes.push_back(box_of(s));
    std::vector<int> order(surfaces.size());
    std::iota(order.begin(), order.end(), 0);
    Node root{};
    root.count = static_cast<int32_t>(order.size());
    nodes_.push_back(root);
    split(0, order, boxes);
    for (int i : order) surfaces_.push_back(surfaces[static_cast<size_t>(i)]);
}

// Divide a node's surfaces at the median of their middles along the box's longest side.
void Surfaces::split(int node, std::vector<int>& order, const std::vector<Node>& boxes) {
    const int32_t first = nodes_[node].first, count = nodes_[node].count;
    if (!count) return;
    Node box = boxes[order[first]];
    for (int i = first + 1; i < first + count; ++i) enclose(box, boxes[order[i]]);
    box.first = first, box.count = count;
    nodes_[node] = box;
    if (count <= FEW) return;
    int axis = 0;
    for (int c = 1; c < 3; ++c)
        if (box.high[c] - box.low[c] > box.high[axis] - box.low[axis]) axis = c;
    const auto begin = order.begin() + first, middle = begin + count / 2;
    std::nth_element(begin, middle, begin + count, [&](int a, int b) {
        return boxes[a].low[axis] + boxes[a].high[axis] < boxes[b].low[axis] + boxes[b].high[axis];
    });
    const int children = static_cast<int>(nodes_.size());
    nodes_[node].first = children, nodes_[node].count = 0;
    Node left{}, right{};
    left.first = first, left.count = count / 2;
    right.first = first + count / 2, right.count = count - count / 2;
    nodes_.push_back(left), nodes_.push_back(right);
    split(children, order, boxes), split(children + 1, order, boxes);
}

Hit Surfaces::first_hit(const Ray& ray) const {
    Hit hit{INFINITE, -1, 0, 0};
    if (surfaces_.empty()) return hit;
    float inverse[3];
    for (int c = 0; c < 3; ++c) inverse[c] = 1 / (ray.direction[c] == 0 ? 1e-30f : ray.direction[c]);
    int32_t waiting[DEEPEST];
    int depth = 0;
    waiting[depth++] = 0;
    while (depth) {
        const Node& node = nodes_[waiting[--depth]];
        if (entry(node, ray.origin, inverse, hit.distance) == INFINITE) continue;
        if (node.count) {
            for (int i = node.first; i < node.first + node.count; ++i) meet(surfaces_[i], i, ray, hit);
            continue;
        }
        int32_t near = node.first, far = node.first + 1;
        if (entry(nodes_[far], ray.origin, inverse, hit.distance) < entry(nodes_[near], ray.origin, inverse, hit.distance))
            std::swap(near, far);
        waiting[depth++] = far, waiting[depth++] = near;  // the tree is balanced: 64 levels are never reached
    }
    return hit;
}

void Surfaces::look_up(const Hit& hit, float* light) const {
    std::fill(light, light + 4, 0.f);
    if (hit.surface < 0) return;
    const Surface& s = surfaces_[hit.surface];
    const Texture& t = textures_[s.texture];
    float u = s.texel[0] + hit.a * s.texel_side[0][0] + hit.b * s.texel_side[1][0];
    float v = s.texel[1] + hit.a * s.texel_side[0][1] + hit.b * s.texel_side[1][1];
    if (!t.repeats) {
        u = std::clamp(u, 0.f, static_cast<float>(t.width - 1)), v = std::clamp(v, 0.f, static_cast<float>(t.height - 1));
    }
    const float left = std::floor(u), top = std::floor(v), fu = u - left, fv = v - top;
    const auto column = [&](int i) { return t.repeats ? around(i, t.width) : std::min(i, t.width - 1); };
    const auto row = [&](int i) { return t.repeats ? around(i, t.height) : std::min(i, t.height - 1); };
    const int x[2] = {column(static_cast<int>(left)), column(static_cast<int>(left) + 1)};
    const int y[2] = {row(static_cast<int>(top)), row(static_cast<int>(top) + 1)};
    for (int j = 0; j < 2; ++j)
        for (int i = 0; i < 2; ++i) {
            const float weight = (i ? fu : 1 - fu) * (j ? fv : 1 - fv);
            const float* texel = texels_.data() + 4 * (t.first + int64_t{y[j]} * t.width + x[i]);
            for (int c = 0; c < 4; ++c) light[c] += weight * texel[c];
        }
}

void Surfaces::radiance(const float* origins, const float* directions, int64_t count, float* light,
                        float* distances) const {
    Work work{*this, origins, directions, count, light, distances};
    parallel_for(static_cast<int>((count + PORTION - 1) / PORTION), &look, &work);
}

}  // namespace omnimirror
