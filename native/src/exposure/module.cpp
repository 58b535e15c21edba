// Exposing pictures as omnimirror.simulate.rendering.exposure calls it.
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

// Optics with the meridian that they point to.
struct OwnedOptics {
    Optics optics;
    std::vector<MeridianNode> nodes;
};

template <size_t N>
void copy(const Numbers<N>& from, float (&to)[N]) {
    std::copy(from.begin(), from.end(), to);
}

OwnedOptics* make_optics(bool telecentric, Numbers<2> centre, Numbers<2> scale, Numbers<5> distortion, float fold,
                         float focus, float stop, Numbers<3> vertex, Numbers<9> axes, bool aligned, float curvature, float conic,
                         float rim, const Floats& nodes, Numbers<8> reflectance, float natural_vignetting,
                         float body_z, float body_radius, float lens_radius, float edge_z, float edge_radius,
                         Numbers<2> rod_z, Numbers<2> rod_radius,
                         Numbers<3> housing_light, bool sees_past, Numbers<9> rotation, Numbers<3> shift,
                         bool distant) {
    require(nodes.ndim() == 2 && nodes.shape(1) == 3 && nodes.shape(0) != 1 && nodes.shape(0) < (1u << 24),
            "nodes are (n, 3), none or at least two");
    require(rim > 0, "the rim's radius is above 0");
    auto owned = std::make_unique<OwnedOptics>();
    Optics& o = owned->optics;
    o.telecentric = telecentric, o.focus = focus, o.fold = fold, o.stop = stop, o.aligned = aligned;
    o.curvature = curvature, o.conic = conic, o.rim = rim, o.natural_vignetting = natural_vignetting;
    o.body_z = body_z, o.body_radius = body_radius, o.lens_radius = lens_radius, o.sees_past = sees_past;
    o.edge_z = edge_z, o.edge_radius = edge_radius, o.distant = distant;
    copy(centre, o.centre), copy(scale, o.scale), copy(distortion, o.distortion), copy(vertex, o.vertex);
    copy(axes, o.axes), copy(reflectance, o.reflectance), copy(rod_z, o.rod_z), copy(rod_radius, o.rod_radius);
    copy(housing_light, o.housing_light), copy(rotation, o.rotation), copy(shift, o.shift);
    for (size_t i = 0; i < nodes.shape(0); ++i)
        owned->nodes.push_back({nodes.data()[3 * i], nodes.data()[3 * i + 1], nodes.data()[3 * i + 2]});
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
    require(light.ndim() == 3 && light.shape(2) == 3 && light.shape(0) > 0 && light.shape(1) > 0,
            "an environment is (height, width, 3)");
    require(light.shape(0) <= (1u << 16) && light.shape(1) <= (1u << 16), "valid are sides up to 65536");
    const size_t height = light.shape(0), width = light.shape(1);
    auto owned = std::make_unique<OwnedEnvironment>();
    owned->texels.resize(4 * height * (width + 2));
    float* out = owned->texels.data();
    for (size_t row = 0; row < height; ++row)
        for (size_t column = 0; column < width + 2; ++column, out += 4)
            std::copy_n(light.data() + 3 * (row * width + column % width), 3, out);
    owned->environment = {owned->texels.data(), static_cast<int>(width), static_cast<int>(height)};
    return owned.release();
}

Exposure exposure_of(const OwnedOptics& owned, const Floats& points, bool shifted, uint32_t seed, int left,
                     int64_t width, int top, int64_t count) {
    require(points.ndim() == 2 && points.shape(1) == 4 && points.shape(0) >= 1 && points.shape(0) <= (1u << 20),
            "sample points are (n, 4)");
    require(width >= 0 && width <= (1 << 20) && count >= 0 && count <= (1 << 20), "a side is too long");
    require(std::abs(left) <= (1 << 20) && std::abs(top) <= (1 << 20), "the place is too far away");
    return {owned.optics, {points.data(), static_cast<int>(points.shape(0)), shifted, seed}, left,
            static_cast<int>(width)};
}

void expose_environment(const OwnedOptics& optics, const OwnedEnvironment& world, const Floats& points, bool shifted,
                        uint32_t seed, int left, int top, const FloatsOut& light) {
    require(light.ndim() == 3 && light.shape(2) == 3, "light is (rows, columns, 3)");
    const int64_t rows = static_cast<int64_t>(light.shape(0)), columns = static_cast<int64_t>(light.shape(1));
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, columns, top, rows);
    nb::gil_scoped_release released;
    expose(exposure, world.environment, top, static_cast<int>(rows), light.data());
}

void expose_rays(const OwnedOptics& optics, const Floats& points, bool shifted, uint32_t seed, int left, int top,
                 const FloatsOut& origins, const FloatsOut& directions, const FloatsOut& weights,
                 const BytesOut& fates) {
    require(fates.ndim() == 3 && fates.shape(2) == points.shape(0), "fates are (rows, columns, samples)");
    require(origins.size() == 3 * fates.size() && directions.size() == 3 * fates.size() &&
                weights.size() == fates.size(),
            "the arrays differ in size");
    const int64_t rows = static_cast<int64_t>(fates.shape(0)), columns = static_cast<int64_t>(fates.shape(1));
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, columns, top, rows);
    nb::gil_scoped_release released;
    expose(exposure, top, static_cast<int>(rows), {origins.data(), directions.data(), weights.data(), fates.data()});
}

int64_t expose_surfaces(const OwnedOptics& optics, const Surfaces& surfaces, const Floats& points, bool shifted,
                        uint32_t seed, int left, int top, const FloatsOut& light, const IntsOut& open_pixels,
                        const FloatsOut& open_rays) {
    require(light.ndim() == 3 && light.shape(2) == 3, "light is (rows, columns, 3)");
    const int64_t rows = static_cast<int64_t>(light.shape(0)), columns = static_cast<int64_t>(light.shape(1));
    const Exposure exposure = exposure_of(optics, points, shifted, seed, left, columns, top, rows);
    require(rows * columns <= (1 << 28), "the part of the picture is too large");
    const bool wanted = open_pixels.size() > 0;
    require(!wanted || static_cast<int64_t>(open_pixels.size()) >= rows * columns * exposure.samples.count,
            "there is no room for all rays that may be open");
    require(open_rays.size() == 7 * open_pixels.size(), "the arrays differ in size");
    nb::gil_scoped_release released;
    return expose(exposure, surfaces.tree(), top, static_cast<int>(rows), light.data(),
                  {open_pixels.data(), open_rays.data(), wanted});
}

}  // namespace

void add_exposure(nb::module_& m) {
    nb::class_<OwnedOptics>(m, "Optics")
        .def(nb::new_(&make_optics), nb::kw_only(), "telecentric"_a, "centre"_a, "scale"_a, "distortion"_a, "fold"_a,
             "focus"_a, "stop"_a, "vertex"_a, "axes"_a, "aligned"_a, "curvature"_a, "conic"_a, "rim"_a, "nodes"_a,
             "reflectance"_a, "natural_vignetting"_a, "body_z"_a, "body_radius"_a, "lens_radius"_a, "edge_z"_a, "edge_radius"_a, "rod_z"_a, "rod_radius"_a,
             "housing_light"_a, "sees_past"_a, "rotation"_a, "shift"_a, "distant"_a);
    nb::class_<OwnedEnvironment>(m, "Environment").def(nb::new_(&make_environment), "light"_a);
    m.def("expose_environment", &expose_environment, "optics"_a, "environment"_a, "points"_a, "shifted"_a, "seed"_a,
          "left"_a, "top"_a, "light"_a);
    m.def("expose_rays", &expose_rays, "optics"_a, "points"_a, "shifted"_a, "seed"_a, "left"_a, "top"_a, "origins"_a,
          "directions"_a, "weights"_a, "fates"_a);
    m.def("expose_surfaces", &expose_surfaces, "optics"_a, "surfaces"_a, "points"_a, "shifted"_a, "seed"_a, "left"_a,
          "top"_a, "light"_a, "open_pixels"_a, "open_rays"_a);
}

}  // namespace omnimirror
