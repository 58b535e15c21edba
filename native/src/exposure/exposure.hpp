// Image exposure: rays from the image sensor through the aperture of the lens, via the mirror, into the scene.
//
// The lens is thin, and its stop is in the lens plane. The origin of the camera frame is the centre of the lens, or the
// mirror vertex if the lens is telecentric; X points right and Y down in the image, Z towards the mirror. All lengths
// are in mm. Rays are traced in single precision, with errors of about 1e-5 mm and 1e-6 rad.
#pragma once

#include <cstdint>

#include "surfaces.hpp"

namespace omnimirror {

// One node of a mirror's meridian.
struct MeridianNode {
    float sag, slope, curvature;
};

struct Optics {
    // lens: the tangents of a pixel (offsets in mm if telecentric) are scale (pixel - centre)
    bool telecentric = false;
    float centre[2] = {0, 0}, scale[2] = {1, 1};
    float distortion[5] = {0, 0, 0, 0, 0};  // Brown's k1, k2, k3, p1, p2, of undistorted tangents
    float fold = 1e3f;                // tangent above which the distortion is not invertible
    float focus = 1;                  // distance to the plane in focus
    float stop = 0;                   // radius of the aperture; tangent of the half cone angle if telecentric
    // mirror vertex in the camera frame, and mirror axes as rows: right, down, away from the lens
    float vertex[3] = {0, 0, 0}, axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};
    bool aligned = true;
    // mirror surface: a conic, or nodes at equal steps from the axis to the rim, with the conic as initial value
    float curvature = 0, conic = 0, rim = 1;
    const MeridianNode* nodes = nullptr;
    int cells = 0;
    float step = 1;
    float reflectance[8] = {1, 0, 0, 0, 0, 0, 0, 0};  // power series in 1 - cos(gamma)
    float natural_vignetting = 0;                     // 1: cos^4 falloff
    // obscurations, rotationally symmetric about the lens axis: the camera front (a disc at z = body_z, visible in
    // mirrored rays) and a tapered rod from it to the mirror
    float body_z = 0, body_radius = 0, lens_radius = 1;  // lens_radius: of the visible front ring of the lens
    float rod_z[2] = {0, 0}, rod_radius[2] = {0, 0};
    float edge_z = 0, edge_radius = 0;  // a dark edge around the rim, in the mirror frame
    float housing_light[3] = {0, 0, 0};
    bool direct_view = false;  // whether rays that miss the mirror reach the scene behind it, or are lost
    // from the camera frame to the world frame
    float rotation[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, shift[3] = {0, 0, 0};
    bool distant = false;  // the scene is infinitely far away: all rays start at the shift
};

// Sample points of a pixel, (count, 4) in [0, 1): position on the pixel, position on the aperture. Each pixel offsets
// them by its own random shift if `shifted` is set.
struct Samples {
    const float* points;
    int count;
    bool shifted;
    uint32_t seed;
};

// Equirectangular environment at infinity: columns from -180 to 180 deg of pan, rows from the zenith downwards. Texels
// are red, green, blue, unused; each row ends with copies of its first two texels.
struct Environment {
    const float* texels;
    int width, height;
};

// Fates of rays.
constexpr float LOST = 0, REFLECTED = 1, DIRECT = 2, OBSCURED = 3;

struct RayOut {
    float *origins, *directions, *weights;  // (n, 3), (n, 3), (n)
    uint8_t* fates;                         // (n)
};

// Consecutive rays of a row, as packets for surface intersection; rays that reach nothing have no limit.
constexpr int BLOCK = 64;
struct alignas(64) RayBlock {
    Packet packets[BLOCK / PACKET];
    float weights[BLOCK], fates[BLOCK];
};

// Rays that reach the background behind all surfaces, each with the index of the pixel (counted over the rows) to which
// it contributes.
struct OpenRays {
    int32_t* pixels;
    float* rays;  // (n, 7): weight, origin, direction
    bool is_requested;
};

struct Exposure {
    Optics optics;
    Samples samples;
    int left, width;  // columns
};

struct ExposureKernels {
    // Mean radiance (width, 3) of the pixels of a row.
    void (*light)(const Exposure&, const Environment&, int row, float* out);
    // All rays of the pixels of a row.
    void (*rays)(const Exposure&, int row, const RayOut& out);
    // Rays of a row, starting with number `first`; returns whether any of them is not lost.
    bool (*block)(const Exposure&, int row, int64_t first, RayBlock& out);
};

extern const ExposureKernels plain_exposure;
#if defined(OMNIMIRROR_AVX2)
extern const ExposureKernels avx2_exposure;
#endif

// Render rows [top, top + count) of an image on the thread pool; light is (count, width, 3).
void expose(const Exposure&, const Environment&, int top, int count, float* light);
void expose(const Exposure&, int top, int count, const RayOut& out);
// Render surfaces, on the calling thread only; returns the number of open rays.
int64_t expose(const Exposure&, const SurfaceTree&, int top, int count, float* light, const OpenRays& open);

}  // namespace omnimirror
