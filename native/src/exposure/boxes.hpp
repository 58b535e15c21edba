// Axis-aligned boxes in the world frame, and ray intersection in double precision, for ground-truth depth.
#pragma once

#include <cstdint>

namespace omnimirror {

struct Boxes {
    const double *lows, *highs;  // (count, 3) corners, mm
    int count;
};

struct BoxRays {
    const double *origins, *directions;  // (count, 3); directions are not normalised, but not zero
    int64_t count;
};

// Compute the first faces hit by rays that start inside the first box: a face of another box, hit from outside, or of
// the first box itself. Distances are >= 0, in lengths of the direction; a face is 6 box + 2 axis + side, where side 0
// is the lower one.
void intersect_boxes(const Boxes& boxes, const BoxRays& rays, double* distances, int32_t* faces);

// Return whether line segments, from origins to origins + directions, pass through a box.
void are_blocked(const Boxes& boxes, const BoxRays& segments, uint8_t* blocked);

}  // namespace omnimirror
