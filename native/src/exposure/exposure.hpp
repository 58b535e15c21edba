// Exposing a picture: rays from the imager through the lens's aperture, off the mirror, into the world.
//
// The lens is thin and its stop lies in it. In the camera frame its centre is the origin, X points right and Y
// down in the picture, Z towards the mirror; under a telecentric lens the origin is the mirror's vertex. All
// lengths are mm. Rays are traced in float, which is good to 1e-5 mm and 1e-6 rad here.
#pragma once

#include <cstdint>

#include "surfaces.hpp"

namespace omnimirror {

// One node of a mirror's meridian.
struct MeridianNode {
    float sag, slope, curvature;
};

struct Optics {
    // the lens: tangents of a pixel (offsets in mm under a telecentric lens) are scale (pixel - centre)
    bool telecentric = false;
    float centre[2] = {0, 0}, scale[2] = {1, 1};
    float distortion[5] = {0, 0, 0, 0, 0};  // Brown's k1, k2, k3, p1, p2, of tangents without it
    float fold = 1e3f;                // the tangent at which it folds the picture over
    float focus = 1;                  // to the plane in focus
    float stop = 0;                   // radius of the aperture; tangent of the cone's half angle if telecentric
    // the mirror's vertex in the camera frame, and its axes as rows; right, down, away from the lens
    float vertex[3] = {0, 0, 0}, axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    bool aligned = true;
    // its surface: a conic, or nodes at equal steps from the axis to the rim; then the conic is a first guess
    float curvature = 0, conic = 0, rim = 1;
    const MeridianNode* nodes = nullptr;
    int cells = 0;
    float step = 1;
    float reflectance[8] = {1, 0, 0, 0, 0, 0, 0, 0};  // a series in 1 - cos(gamma)
    float natural_vignetting = 0;                     // 1: light falls with the fourth power of the cosine
    // what stands in the light, all about the lens's axis: the camera's front (a disk at z = body_z, seen by
    // mirrored rays) and a rod that tapers from it to the mirror
    float body_z = 0, body_radius = 0, lens_radius = 1;  // of the front ring of its lens, which can be made out
    float rod_z[2] = {0, 0}, rod_radius[2] = {0, 0};
    float edge_z = 0, edge_radius = 0;  // a dark edge about the rim, in the mirror's frame
    float housing_light[3] = {0, 0, 0};
    bool sees_past = false;  // whether rays that miss the mirror see the world behind it, or nothing
    // from the camera frame to the world
    float rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, shift[3] = {0, 0, 0};
    bool distant = false;  // the world is infinitely far away: all rays start at the shift
};

// Points of all samples of a pixel, (count, 4) in [0, 1): place on the pixel, place on the aperture. Each pixel
// shifts them by an amount of its own unless they are fixed.
struct Samples {
    const float* points;
    int count;
    bool shifted;
    uint32_t seed;
};

// An environment infinitely far away, equirectangular: columns from -180 to 180 deg of pan, rows from the zenith
// down. Texels are red, green, blue, unused; each row ends with two more, the first ones again.
struct Environment {
    const float* texels;
    int width, height;
};

// What a row of rays becomes: light, or the rays themselves.
constexpr float LOST = 0, REFLECTED = 1, DIRECT = 2, HIDDEN = 3;

struct RayOut {
    float *origins, *directions, *weights;  // (n, 3), (n, 3), (n)
    uint8_t* fates;                         // (n)
};

// Rays of a row, one after the other, as surfaces are asked for them; those that see nothing have no limit.
constexpr int BLOCK = 64;
struct alignas(64) RayBlock {
    Packet packets[BLOCK / PACKET];
    float weights[BLOCK], fates[BLOCK];
};

// Rays that see what is behind all surfaces: the pixel, counted through the rows, that each adds its share of light to.
struct OpenRays {
    int32_t* pixels;
    float* rays;  // (n, 7): share, origin, direction
    bool wanted;
};

struct Exposure {
    Optics optics;
    Samples samples;
    int left, width;  // columns
};

struct ExposureKernels {
    // Mean light (width, 3) of the pixels of a row.
    void (*light)(const Exposure&, const Environment&, int row, float* out);
    // All rays of the pixels of a row.
    void (*rays)(const Exposure&, int row, const RayOut& out);
    // Rays of a row from number `first` on; whether any of them got anywhere.
    bool (*block)(const Exposure&, int row, int64_t first, RayBlock& out);
};

extern const ExposureKernels plain_exposure;
#if defined(OMNIMIRROR_AVX2)
extern const ExposureKernels avx2_exposure;
#endif

// Rows [top, top + count) of a picture, on the pool; light is (count, width, 3).
void expose(const Exposure&, const Environment&, int top, int count, float* light);
void expose(const Exposure&, int top, int count, const RayOut& out);
// The same of surfaces, on the calling thread alone; how many rays are open.
int64_t expose(const Exposure&, const SurfaceTree&, int top, int count, float* light, const OpenRays& open);

}  // namespace omnimirror
