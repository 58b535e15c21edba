// Python interface of image exposure, used by omnimirror.simulation.rendering.
#include <nanobind/stl/array.h>

#include <algorithm>
#include <array>
#include <memory>
#include <vector>

#include "bindings.hpp"
#include "exposure.hpp"

namespace omnimirror {
namespace {

template <size_t N>
using Numbers = std::array<float, N>;

// Optics, with the meridian to which they point.
struct OwnedOptics {
    Optics optics;
    std::vector<MeridianNode> nodes;
};

// The kernels are compiled with -ffast-math, which assumes finite numbers. Lengths in mm, pixels and tangents are far
// below this limit, whose squares and products are finite.
constexpr float MAX_MAGNITUDE = 1e12f;

template <size_t N>
void copy(const Numbers<N>& from, float (&to)[N], const char* name) {
    for (size_t i = 0; i < N; ++i) to[i] = checked(from[i], name, -MAX_MAGNITUDE, MAX_MAGNITUDE);
}

OwnedOptics* make_optics(bool telecentric, Numbers<2> centre, Numbers<2> scale, Numbers<5> distortion, float fold,
                         float focus, float stop, Numbers<3> vertex, Numbers<9> axes, bool aligned, float curvature,
                         float conic, float rim, const Floats& nodes, Numbers<8> reflectance, float natural_vignetting,
                         float body_z, float body_radius, float lens_radius, float edge_z, float edge_radius,
                         Numbers<2> rod_z, Numbers<2> rod_radius, Numbers<3> housing_light, bool direct_view,
                         Numbers<9> rotation, Numbers<3> shift, bool distant) {
    const float* node = checked(nodes, "nodes", {ANY, 3});
    const int count = count_of(nodes.shape(0), "nodes", 1 << 24);
    require(count != 1, "nodes must have 0 or at least 2 rows");
    require(rim > 0, "rim must be above 0");
    auto owned = std::make_unique<OwnedOptics>();
    Optics& o = owned->optics;
    o.telecentric = telecentric, o.aligned = aligned, o.direct_view = direct_view, o.distant = distant;
    const auto set = [](float& to, float value, const char* name) {
        to = checked(value, name, -MAX_MAGNITUDE, MAX_MAGNITUDE);
    };
    set(o.fold, fold, "fold"), set(o.focus, focus, "focus"), set(o.stop, stop, "stop");
    set(o.curvature, curvature, "curvature"), set(o.conic, conic, "conic"), set(o.rim, rim, "rim");
    set(o.natural_vignetting, natural_vignetting, "natural_vignetting");
    set(o.body_z, body_z, "body_z"), set(o.body_radius, body_radius, "body_radius");
    set(o.lens_radius, lens_radius, "lens_radius");
    set(o.edge_z, edge_z, "edge_z"), set(o.edge_radius, edge_radius, "edge_radius");
    copy(centre, o.centre, "centre"), copy(scale, o.scale, "scale"), copy(distortion, o.distortion, "distortion");
    copy(vertex, o.vertex, "vertex"), copy(axes, o.axes, "axes"), copy(reflectance, o.reflectance, "reflectance");
    copy(rod_z, o.rod_z, "rod_z"), copy(rod_radius, o.rod_radius, "rod_radius");
    copy(housing_light, o.housing_light, "housing_light");
    copy(rotation, o.rotation, "rotation"), copy(shift, o.shift, "shift");
    for (int i = 0; i < 3 * count; ++i) checked(node[i], "nodes", -MAX_MAGNITUDE, MAX_MAGNITUDE);
    for (int i = 0; i < count; ++i) owned->nodes.push_back({node[3 * i], node[3 * i + 1], node[3 * i + 2]});
    if (!owned->nodes.empty()) {
        o.nodes = owned->nodes.data(), o.cells = static_cast<int>(owned->nodes.size()) - 1;
        o.step = rim / static_cast<float>(o.cells);
    }
    return owned.release();
}

struct OwnedEnvironment {
    Environment environment;
    std::vector<float> texels;
};

OwnedEnvironment* make_environment(const Floats& light) {
    const float* pixels = checked(light, "light", {ANY, ANY, 3});
    const size_t height = light.shape(0), width = light.shape(1);
    for (const size_t side : {height, width})
        checked<double>(static_cast<double>(side), "image size of light", 1, 1 << 16);
    auto owned = std::make_unique<OwnedEnvironment>();
    owned->texels.resize(4 * height * (width + 2));
    float* out = owned->texels.data();
    for (size_t row = 0; row < height; ++row)
        for (size_t column = 0; column < width + 2; ++column, out += 4)
            std::copy_n(pixels + 3 * (row * width + column % width), 3, out);
    owned->environment = {owned->texels.data(), static_cast<int>(width), static_cast<int>(height)};
    return owned.release();
}

constexpr int MAX_PIXEL_INDEX = 1 << 20;  // maximum number of rows, columns and samples

Exposure exposure_of(const OwnedOptics& owned, const Floats& points, bool shifted, uint32_t seed, int left, int top,
                     int64_t rows, int64_t columns) {
    const float* first = checked(points, "points", {ANY, 4});
    const int samples = count_of(points.shape(0), "points", MAX_PIXEL_INDEX);
    require(samples > 0, "points must not be empty");
    for (const int64_t side : {rows, columns}) checked<int64_t>(side, "image size", 0, MAX_PIXEL_INDEX);
    for (const int place : {left, top}) checked(place, "left and top", -MAX_PIXEL_INDEX, MAX_PIXEL_INDEX);
    return {owned.optics, {first, samples, shifted, seed}, left, static_cast<int>(columns)};
}

void expose_environment(const OwnedOptics& optics, const OwnedEnvironment& world, const Floats& points, bool shifted,
                        uint32_t seed, int left, int top, const FloatsOut& light) {
    float* out = checked(light, "light", {ANY, ANY, 3});
    const int64_t rows = length_of(light, 0), columns = length_of(light, 1);
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, top, rows, columns);
    nb::gil_scoped_release released;
    expose(exposure, world.environment, top, static_cast<int>(rows), out);
}

void expose_rays(const OwnedOptics& optics, const Floats& points, bool shifted, uint32_t seed, int left, int top,
                 const FloatsOut& origins, const FloatsOut& directions, const FloatsOut& weights,
                 const BytesOut& fates) {
    const int64_t samples = length_of(points, 0), rows = length_of(fates, 0), columns = length_of(fates, 1);
    const RayOut out{checked(origins, "origins", {rows, columns, samples, 3}),
                     checked(directions, "directions", {rows, columns, samples, 3}),
                     checked(weights, "weights", {rows, columns, samples}),
                     checked(fates, "fates", {ANY, ANY, samples})};
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, top, rows, columns);
    nb::gil_scoped_release released;
    expose(exposure, top, static_cast<int>(rows), out);
}

int64_t expose_surfaces(const OwnedOptics& optics, const Surfaces& surfaces, const Floats& points, bool shifted,
                        uint32_t seed, int left, int top, const FloatsOut& light, const IntsOut& open_pixels,
                        const FloatsOut& open_rays) {
    float* out = checked(light, "light", {ANY, ANY, 3});
    const int64_t rows = length_of(light, 0), columns = length_of(light, 1);
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, top, rows, columns);
    checked<int64_t>(rows * columns, "pixels of light", 0, 1 << 28);
    const int64_t room = length_of(open_pixels, 0);
    const OpenRays open{checked(open_pixels, "open_pixels", {ANY}), checked(open_rays, "open_rays", {room, 7}), room > 0};
    require(!open.is_requested || room >= rows * columns * exposure.samples.count,
            "open_pixels must have length 0 or one entry per ray");
    nb::gil_scoped_release released;
    return expose(exposure, surfaces.tree(), top, static_cast<int>(rows), out, open);
}

}  // namespace

void add_exposure(nb::module_& m) {
    nb::class_<OwnedOptics>(m, "Optics")
        .def(nb::new_(&make_optics), nb::kw_only(), "telecentric"_a, "centre"_a, "scale"_a, "distortion"_a, "fold"_a,
             "focus"_a, "stop"_a, "vertex"_a, "axes"_a, "aligned"_a, "curvature"_a, "conic"_a, "rim"_a, "nodes"_a,
             "reflectance"_a, "natural_vignetting"_a, "body_z"_a, "body_radius"_a, "lens_radius"_a, "edge_z"_a,
             "edge_radius"_a, "rod_z"_a, "rod_radius"_a, "housing_light"_a, "direct_view"_a, "rotation"_a, "shift"_a,
             "distant"_a);
    nb::class_<OwnedEnvironment>(m, "Environment").def(nb::new_(&make_environment), "light"_a);
    m.def("expose_environment", &expose_environment, "optics"_a, "environment"_a, "points"_a, "shifted"_a, "seed"_a,
          "left"_a, "top"_a, "light"_a);
    m.def("expose_rays", &expose_rays, "optics"_a, "points"_a, "shifted"_a, "seed"_a, "left"_a, "top"_a, "origins"_a,
          "directions"_a, "weights"_a, "fates"_a);
    m.def("expose_surfaces", &expose_surfaces, "optics"_a, "surfaces"_a, "points"_a, "shifted"_a, "seed"_a, "left"_a,
          "top"_a, "light"_a, "open_pixels"_a, "open_rays"_a);
}

}  // namespace omnimirror
