// Boxes along the world's axes, and the first of them that a ray meets: in double precision, for depth that is told.
#pragma once

#include <cstdint>

namespace omnimirror {

struct Boxes {
    const double *lows, *highs;  // (count, 3) corners, mm
    int count;
};

struct BoxRays {
    const double *origins, *directions;  // (count, 3); directions of any length but 0
    int64_t count;
};

// The faces that rays from inside the first box meet: of another one, met from outside, or of the first itself.
// Distances in lengths of the direction, at least 0; faces 6 box + 2 axis + side, side 0 being the low one.
void meet_boxes(const Boxes& boxes, const BoxRays& rays, double* distances, int32_t* faces);

// Whether straight ways lead through a box: from origins, as far as directions are long.
void lead_through_boxes(const Boxes& boxes, const BoxRays& ways, uint8_t* through);

}  // namespace omnimirror
