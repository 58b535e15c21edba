// A binary bounding volume hierarchy, split with the surface area heuristic: a ray that hits a box hits a box inside it
// with a probability equal to the ratio of their areas (MacDonald and Booth, 1990). Candidate splits are the borders of
// equal bins (Wald, 2007).
#include <algorithm>
#include <cmath>

#include "surfaces.hpp"

namespace omnimirror {
namespace {

constexpr int BINS = 16;
constexpr int LEAF_SIZE = 4,
              MAX_LEAF_SIZE = 8;     // leaf sizes: always accepted, and accepted if a split does not cost less
constexpr float SURFACE_COST = 2;    // cost of a surface test, in box tests
constexpr int MIN_MEDIAN_SPLIT_LEVEL = 32;  // level from which surfaces are halved by number, which bounds the depth

struct Box {
    float low[3] = {INFINITE, INFINITE, INFINITE}, high[3] = {-INFINITE, -INFINITE, -INFINITE};

    void add(const Box& other) {
        for (int c = 0; c < 3; ++c) low[c] = std::min(low[c], other.low[c]), high[c] = std::max(high[c], other.high[c]);
    }
    float middle(int axis) const { return 0.5f * (low[axis] + high[axis]); }
    float area() const {  // half the surface area; 0 for an empty box
        const float x = high[0] - low[0], y = high[1] - low[1], z = high[2] - low[2];
        return x < 0 ? 0 : x * y + y * z + z * x;
    }
};

Box box_of(const Surface& s) {
    Box box;
    for (int c = 0; c < 3; ++c) {
        const float p = s.corner[c], a = s.side[0][c], b = s.side[1][c];
        const float far = s.triangle() ? p : p + a + b;
        box.low[c] = std::min({p, p + a, p + b, far}), box.high[c] = std::max({p, p + a, p + b, far});
        const float padding = 1e-5f * std::max({1.f, std::fabs(box.low[c]), std::fabs(box.high[c])});
        box.low[c] -= padding, box.high[c] += padding;  // flat surfaces also get a box of nonzero thickness
    }
    return box;
}

// Return whether single precision resolves the sides of a surface; intersections with thinner surfaces are undefined.
bool is_resolved(const Surface& s) {
    double largest = 0, square = 0, longest = 0;
    for (int c = 0; c < 3; ++c) {
        const int d = (c + 1) % 3;
        const double across = double{s.side[0][c]} * s.side[1][d] - double{s.side[0][d]} * s.side[1][c];
        square += across * across;
        largest = std::max({largest, std::fabs(double{s.corner[c]}), std::fabs(double{s.side[0][c]}),
                            std::fabs(double{s.side[1][c]})});
    }
    for (const auto& side : s.side)
        longest = std::max(longest, std::hypot(double{side[0]}, double{side[1]}, double{side[2]}));
    return std::sqrt(square) > 1e-7 * largest * longest;
}

// A border between bins of centres along an axis.
struct Split {
    int axis = -1, bin = 0;
    float cost = INFINITE;
};

class Builder {
  public:
    explicit Builder(const std::vector<Surface>& surfaces) : boxes_(surfaces.size()) {
        std::transform(surfaces.begin(), surfaces.end(), boxes_.begin(), &box_of);
        for (size_t i = 0; i < surfaces.size(); ++i)
            if (is_resolved(surfaces[i])) order.push_back(static_cast<int>(i));
    }

    void build() {
        if (order.empty()) return;
        nodes.emplace_back();
        build_node(0, 0, static_cast<int>(order.size()), 0);
    }

    std::vector<int> order;
    std::vector<Node> nodes;

  private:
    const Box& box(int i) const { return boxes_[static_cast<size_t>(order[static_cast<size_t>(i)])]; }

    // Create the node of the surfaces [first, end), and its descendants.
    void build_node(size_t node, int first, int end, int level) {
        Box all, middles;
        for (int i = first; i < end; ++i) {
            const Box& b = box(i);
            all.add(b);
            middles.add({{b.middle(0), b.middle(1), b.middle(2)}, {b.middle(0), b.middle(1), b.middle(2)}});
        }
        Node& new_node = nodes[node];
        std::copy_n(all.low, 3, new_node.low), std::copy_n(all.high, 3, new_node.high);
        const int count = end - first;
        const Split best = count > 1 && level < MIN_MEDIAN_SPLIT_LEVEL ? best_split(first, end, middles) : Split{};
        const float leaf_cost = SURFACE_COST * static_cast<float>(count) * all.area();
        if (count <= LEAF_SIZE || (count <= MAX_LEAF_SIZE && 2 * all.area() + SURFACE_COST * best.cost >= leaf_cost)) {
            new_node.first = first, new_node.count = static_cast<uint16_t>(count), new_node.axis = 0;
            return;
        }
        const int axis = best.axis < 0 ? longest(middles) : best.axis;
        const int middle = best.axis < 0 ? split_median(first, end, axis) : split_at(first, end, best, middles);
        const size_t children = nodes.size();
        new_node.first = static_cast<int32_t>(children), new_node.count = 0,
        new_node.axis = static_cast<uint16_t>(axis);
        nodes.emplace_back(), nodes.emplace_back();
        build_node(children, first, middle, level + 1), build_node(children + 1, middle, end, level + 1);
    }

    static int longest(const Box& box) {
        int axis = 0;
        for (int c = 1; c < 3; ++c)
            if (box.high[c] - box.low[c] > box.high[axis] - box.low[axis]) axis = c;
        return axis;
    }

    static int bin_of(const Box& box, int axis, const Box& middles) {
        const float share = (box.middle(axis) - middles.low[axis]) / (middles.high[axis] - middles.low[axis]);
        return std::clamp(static_cast<int>(BINS * share), 0, BINS - 1);
    }

    Split best_split(int first, int end, const Box& middles) const {
        Split best;
        for (int axis = 0; axis < 3; ++axis) {
            if (!(middles.high[axis] > middles.low[axis])) continue;
            Box bins[BINS];
            int counts[BINS] = {};
            for (int i = first; i < end; ++i) {
                const int bin = bin_of(box(i), axis, middles);
                bins[bin].add(box(i)), ++counts[bin];
            }
            float above[BINS];  // cost of all bins from this one on
            Box sum;
            for (int bin = BINS - 1, n = 0; bin > 0; --bin) {
                sum.add(bins[bin]), n += counts[bin];
                above[bin] = sum.area() * static_cast<float>(n);
            }
            sum = {};
            for (int bin = 1, n = 0; bin < BINS; ++bin) {
                sum.add(bins[bin - 1]), n += counts[bin - 1];
                const float cost = sum.area() * static_cast<float>(n) + above[bin];
                if (n > 0 && n < end - first && cost < best.cost) best = {axis, bin, cost};
            }
        }
        return best;
    }

    int split_at(int first, int end, const Split& at, const Box& middles) {
        const auto middle = std::partition(order.begin() + first, order.begin() + end, [&](int i) {
            return bin_of(boxes_[static_cast<size_t>(i)], at.axis, middles) < at.bin;
        });
        return static_cast<int>(middle - order.begin());
    }

    int split_median(int first, int end, int axis) {
        const int middle = first + (end - first) / 2;
        std::nth_element(order.begin() + first, order.begin() + middle, order.begin() + end, [&](int a, int b) {
            return boxes_[static_cast<size_t>(a)].middle(axis) < boxes_[static_cast<size_t>(b)].middle(axis);
        });
        return middle;
    }

    std::vector<Box> boxes_;
};

}  // namespace

std::vector<Node> make_tree(std::vector<Surface>& surfaces) {
    Builder builder(surfaces);
    builder.build();
    std::vector<Surface> ordered;
    ordered.reserve(builder.order.size());
    for (int i : builder.order) ordered.push_back(surfaces[static_cast<size_t>(i)]);
    surfaces.swap(ordered);
    builder.nodes.shrink_to_fit();
    return std::move(builder.nodes);
}

}  // namespace omnimirror
