// A ray is inside a box between the last of the three entries and the first of the three exits through its pairs of
// planes. src/omnimirror/simulation/scenes/surfaces.py contains the equivalent Python implementation, with the same
// order of operations and the same rounding: do not contract or reorder operations here.
#include "boxes.hpp"

#include <algorithm>
#include <limits>

#include "pool.hpp"

namespace omnimirror {
namespace {

constexpr int LANES = 64;            // rays processed together, without branches, so that compilers vectorise the loops
constexpr int64_t AT_A_TIME = 4096;  // rays per task
constexpr double TINY = 1e-300;      // replaces 0 in directions: 1/0 is infinite, and 0 * (1/0) is NaN

using Lane = double[LANES];

struct Bundle {
    Lane origin[3], inverse[3];

    // The last ray is repeated in the remaining lanes.
    Bundle(const BoxRays& rays, int64_t first, int many) {
        for (int i = 0; i < LANES; ++i) {
            const int64_t at = 3 * (first + std::min(i, many - 1));
            for (int k = 0; k < 3; ++k) {
                const double towards = rays.directions[at + k];
                origin[k][i] = rays.origins[at + k];
                inverse[k][i] = 1 / (towards == 0 ? TINY : towards);
            }
        }
    }
};

// Distances at which rays enter and leave a box; a ray misses if it would leave before it enters.
void pass(const Bundle& rays, const double* low, const double* high, Lane& near, Lane& far) {
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

void meet_some(const Boxes& boxes, const Bundle& rays, int many, double* distances, int32_t* faces) {
    Lane nearest, which, near, far;
    pass(rays, boxes.lows, boxes.highs, near, nearest);
    for (int i = 0; i < LANES; ++i) which[i] = 0;
    for (int box = 1; box < boxes.count; ++box) {
        pass(rays, boxes.lows + 3 * box, boxes.highs + 3 * box, near, far);
        for (int i = 0; i < LANES; ++i) {
            const double from = near[i] > 0 ? near[i] : 0;
            const bool is_first = (from < far[i]) & (from < nearest[i]);
            nearest[i] = is_first ? from : nearest[i];
            which[i] = is_first ? box : which[i];
        }
    }
    for (int i = 0; i < many; ++i) {
        const int box = static_cast<int>(which[i]);
        const int axis = axis_of(rays, i, boxes.lows + 3 * box, boxes.highs + 3 * box, box > 0);
        const bool forward = rays.inverse[axis][i] > 0;
        distances[i] = nearest[i], faces[i] = 6 * box + 2 * axis + (forward == (box == 0) ? 1 : 0);
    }
}

template <class Do>
void in_bundles(const BoxRays& rays, const Do& with) {
    struct Work {
        const BoxRays& rays;
        const Do& with;
    } work{rays, with};
    const auto task = [](void* context, int index) {
        const Work& w = *static_cast<const Work*>(context);
        const int64_t end = std::min(w.rays.count, (index + 1) * AT_A_TIME);
        for (int64_t first = index * AT_A_TIME; first < end; first += LANES) {
            const int many = static_cast<int>(std::min<int64_t>(LANES, end - first));
            w.with(Bundle(w.rays, first, many), first, many);
        }
    };
    parallel_for(static_cast<int>((rays.count + AT_A_TIME - 1) / AT_A_TIME), task, &work);
}

}  // namespace

void meet_boxes(const Boxes& boxes, const BoxRays& rays, double* distances, int32_t* faces) {
    in_bundles(rays, [&](const Bundle& bundle, int64_t first, int many) {
        meet_some(boxes, bundle, many, distances + first, faces + first);
    });
}

void lead_through_boxes(const Boxes& boxes, const BoxRays& ways, uint8_t* through) {
    in_bundles(ways, [&](const Bundle& bundle, int64_t first, int many) {
        Lane near, far, leads;
        for (int i = 0; i < LANES; ++i) leads[i] = 0;
        for (int box = 0; box < boxes.count; ++box) {
            pass(bundle, boxes.lows + 3 * box, boxes.highs + 3 * box, near, far);
            for (int i = 0; i < LANES; ++i) {
                const double from = near[i] > 0 ? near[i] : 0, to = far[i] < 1 ? far[i] : 1;
                leads[i] = from < to ? 1 : leads[i];
            }
        }
        for (int i = 0; i < many; ++i) through[first + i] = leads[i] > 0;
    });
}

}  // namespace omnimirror
