// A ray is inside a box between the last of the three entries and the first of the three exits through its pairs of
// planes. src/omnimirror/simulation/scenes/scene.py contains the equivalent Python implementation, with the same
// order of operations and the same rounding: do not contract or reorder operations here.
#include "boxes.hpp"

#include <algorithm>
#include <limits>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr int LANES = 64;            // rays processed together, without branches, so that compilers vectorise the loops
constexpr int64_t RAYS_PER_TASK = 4096;   // rays per task
constexpr double MIN_DIRECTION = 1e-300;  // replaces 0 in directions: 1/0 is infinite, and 0 * (1/0) is NaN

using Lane = double[LANES];

struct Bundle {
    Lane origin[3], inverse[3];

    // The last ray is repeated in the remaining lanes.
    Bundle(const BoxRays& rays, int64_t first, int count) {
        for (int i = 0; i < LANES; ++i) {
            const int64_t at = 3 * (first + std::min(i, count - 1));
            for (int k = 0; k < 3; ++k) {
                const double towards = rays.directions[at + k];
                origin[k][i] = rays.origins[at + k];
                inverse[k][i] = 1 / (towards == 0 ? MIN_DIRECTION : towards);
            }
        }
    }
};

// Distances at which rays enter and leave a box; a ray misses if it would leave before it enters.
void clip_to_box(const Bundle& rays, const double* low, const double* high, Lane& near, Lane& far) {
    for (int i = 0; i < LANES; ++i)
        near[i] = -std::numeric_limits<double>::infinity(), far[i] = std::numeric_limits<double>::infinity();
    for (int k = 0; k < 3; ++k) {
        for (int i = 0; i < LANES; ++i) {
            const double a = (low[k] - rays.origin[k][i]) * rays.inverse[k][i];
            const double b = (high[k] - rays.origin[k][i]) * rays.inverse[k][i];
            const double enters = a < b ? a : b, leaves = a < b ? b : a;
            near[i] = near[i] < enters ? enters : near[i];
            far[i] = leaves < far[i] ? leaves : far[i];
        }
    }
}

// The axis across which a ray enters a box (through the last of the three near planes) or leaves it (through the first
// of the three far planes).
int axis_of(const Bundle& rays, int i, const double* low, const double* high, bool entering) {
    int axis = 0;
    double distance = 0;
    for (int k = 0; k < 3; ++k) {
        const bool forward = rays.inverse[k][i] > 0;
        const double plane = forward != entering ? high[k] : low[k];
        const double at = (plane - rays.origin[k][i]) * rays.inverse[k][i];
        if (k == 0 || (entering ? at > distance : at < distance)) axis = k, distance = at;
    }
    return axis;
}

void intersect_bundle(const Boxes& boxes, const Bundle& rays, int count, double* distances, int32_t* faces) {
    Lane nearest, which, near, far;
    clip_to_box(rays, boxes.lows, boxes.highs, near, nearest);
    for (int i = 0; i < LANES; ++i) which[i] = 0;
    for (int box = 1; box < boxes.count; ++box) {
        clip_to_box(rays, boxes.lows + 3 * box, boxes.highs + 3 * box, near, far);
        for (int i = 0; i < LANES; ++i) {
            const double from = near[i] > 0 ? near[i] : 0;
            const bool is_first = (from < far[i]) & (from < nearest[i]);
            nearest[i] = is_first ? from : nearest[i];
            which[i] = is_first ? box : which[i];
        }
    }
    for (int i = 0; i < count; ++i) {
        const int box = static_cast<int>(which[i]);
        const int axis = axis_of(rays, i, boxes.lows + 3 * box, boxes.highs + 3 * box, box > 0);
        const bool forward = rays.inverse[axis][i] > 0;
        distances[i] = nearest[i], faces[i] = 6 * box + 2 * axis + (forward == (box == 0) ? 1 : 0);
    }
}

template <class Do>
void for_each_bundle(const BoxRays& rays, const Do& with) {
    struct Work {
        const BoxRays& rays;
        const Do& with;
    } work{rays, with};
    const auto task = [](void* context, int index) {
        const Work& w = *static_cast<const Work*>(context);
        const int64_t end = std::min(w.rays.count, (index + 1) * RAYS_PER_TASK);
        for (int64_t first = index * RAYS_PER_TASK; first < end; first += LANES) {
            const int count = static_cast<int>(std::min<int64_t>(LANES, end - first));
            w.with(Bundle(w.rays, first, count), first, count);
        }
    };
    parallel_for(static_cast<int>((rays.count + RAYS_PER_TASK - 1) / RAYS_PER_TASK), task, &work);
}

}  // namespace

void intersect_boxes(const Boxes& boxes, const BoxRays& rays, double* distances, int32_t* faces) {
    for_each_bundle(rays, [&](const Bundle& bundle, int64_t first, int count) {
        intersect_bundle(boxes, bundle, count, distances + first, faces + first);
    });
}

void are_blocked(const Boxes& boxes, const BoxRays& segments, uint8_t* blocked) {
    for_each_bundle(segments, [&](const Bundle& bundle, int64_t first, int count) {
        Lane near, far, is_blocked;
        for (int i = 0; i < LANES; ++i) is_blocked[i] = 0;
        for (int box = 0; box < boxes.count; ++box) {
            clip_to_box(bundle, boxes.lows + 3 * box, boxes.highs + 3 * box, near, far);
            for (int i = 0; i < LANES; ++i) {
                const double from = near[i] > 0 ? near[i] : 0, to = far[i] < 1 ? far[i] : 1;
                is_blocked[i] = from < to ? 1 : is_blocked[i];
            }
        }
        for (int i = 0; i < count; ++i) blocked[first + i] = is_blocked[i] > 0;
    });
}

}  // namespace omnimirror
