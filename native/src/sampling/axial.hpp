// Projection of points and directions to pixels for a rotationally symmetric camera.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace omnimirror {

// Tables over sin(Omega/2), with Omega the field angle from the axis; linear between evenly spaced entries.
struct Axial {
    double axis[3], right[3], down[3];  // world directions: the optical axis, and image right and down
    double x, y;                        // image of the axis
    double x_last, y_last;              // pixels are valid from 0 to these, with a margin of EDGE_PX
    double first, last;                 // sin(Omega/2) at both ends of the tables
    double radii_per, origins_per;      // entries per unit of sin(Omega/2)
    int radii_last, origins_last;       // the last cell of each table
    const double* radii;                // image radii, px
    const double* origins;              // pairs: ray origins across and along the axis; nullptr: at the origin
    double viewpoint;                   // approximate viewpoint for near points, along the axis
};

constexpr double EDGE_PX = 0.5 + 1e-9;  // see EDGE_SLACK of omnimirror.cameras.camera

// Projection targets: contiguous (x, y, z).
struct Targets {
    const double* xyz;
    int64_t count;
    bool is_near;    // points, in the units of the origins; otherwise directions of any length
    double* pixels;  // contiguous (u, v); NaN outside the field or the image
    double* excess;  // approximate distance outside the field, px; at most 0 inside; may be nullptr
};

// A table that is built once and used for many views.
class AxialCamera {
  public:
    AxialCamera(const Axial& camera, std::vector<double> radii, std::vector<double> origins);
    AxialCamera(const AxialCamera&) = delete;
    void project(const Targets& targets) const;

  private:
    std::vector<double> radii_, origins_;
    Axial camera_;
};

}  // namespace omnimirror
