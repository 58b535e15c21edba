// The projection of a camera that is symmetric about an axis: from points and directions to pixels.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace omnimirror {

// Tables over sin(Omega/2), Omega the field angle from the axis, linear between evenly spaced entries.
struct Axial {
    double axis[3], right[3], down[3];  // world directions: seen at the centre, and across it
    double x, y;                        // image of the axis
    double x_last, y_last;              // pixels are seen from 0 to these, and EDGE_PX beyond
    double first, last;                 // sin(Omega/2) at both ends of the tables
    double radii_per, origins_per;      // entries per unit of sin(Omega/2)
    int radii_last, origins_last;       // the last cell of each table
    const double* radii;                // of the image, px
    const double* origins;              // pairs: where rays start, from the axis and along it; nullptr: at the origin
    double viewpoint;                   // about where along the axis near things are seen from
};

constexpr double EDGE_PX = 0.5 + 1e-9;  // see EDGE_SLACK of omnimirror.cameras.camera

// What is to be projected: (x, y, z) one after the other.
struct Targets {
    const double* xyz;
    int64_t count;
    bool is_near;    // points, in the units of the origins; otherwise directions of any length
    double* pixels;  // (u, v) one after the other; NaN outside the field or the picture
    double* excess;  // about how far outside, px; not above 0 within; may be nullptr
};

// A table that is made once and used for many views.
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
