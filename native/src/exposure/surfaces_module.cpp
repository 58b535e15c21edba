// Python interface of textured surfaces and boxes, used by omnimirror.simulation.scenes.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <vector>

#include "bindings.hpp"
#include "boxes.hpp"
#include "surfaces.hpp"

namespace omnimirror {
namespace {

constexpr int MAX_SIDE = (1 << 24) - 1;  // of textures: positions between texels are float
constexpr int64_t MAX_TEXELS = int64_t{1} << 40;

std::vector<Texture> textures_of(const Ints& sizes, int64_t texels) {
    const int32_t* s = checked(sizes, "sizes", {ANY, 3});  // width, height, repetition flag
    std::vector<Texture> textures;
    int64_t first = 0;
    for (size_t i = 0; i < sizes.shape(0); ++i, s += 3) {
        const int width = checked(s[0], "sizes", 1, MAX_SIDE), height = checked(s[1], "sizes", 1, MAX_SIDE);
        textures.push_back({first, width, height, s[2]});
        first = checked<int64_t>(first + int64_t{width} * height, "number of texels", 0, MAX_TEXELS);
    }
    require(first == texels, "texels must have the number of rows specified by sizes");
    return textures;
}

Surfaces* make_surfaces(const Floats& records, const Ints& sizes, const Floats& texels) {
    const float* record = checked(records, "records", {ANY, SURFACE_FLOATS});  // as in surfaces.hpp
    const size_t count = static_cast<size_t>(count_of(records.shape(0), "surfaces", 1 << 27));
    std::vector<Surface> surfaces(count);
    if (count) std::memcpy(static_cast<void*>(surfaces.data()), record, count * sizeof(Surface));
    const float* texel = checked(texels, "texels", {ANY, 4});
    std::vector<Texture> textures = textures_of(sizes, length_of(texels, 0));
    const auto check = [](const float* x, int count) {
        for (int i = 0; i < count; ++i) checked(x[i], "records", -1e15f, 1e15f);
    };
    for (const Surface& s : surfaces) {
        check(s.corner, 3), check(&s.side[0][0], 6), check(s.texel, 2), check(&s.texel_side[0][0], 4);
        require(s.texture() < static_cast<int32_t>(textures.size()),
                "texture indices of records must be less than the length of sizes");
    }
    std::shared_ptr<const float> shared(texel, [reflectance = texels](const float*) {});
    return new Surfaces(std::move(surfaces), std::move(textures), std::move(shared));
}

// The surfaces in the order of the tree, without degenerate ones; a view of the same memory.
auto records_of(nb::handle self) {
    static const Surface none{};  // an empty array also needs a valid pointer
    const std::vector<Surface>& surfaces = nb::cast<const Surfaces&>(self).surfaces();
    const Surface* first = surfaces.empty() ? &none : surfaces.data();
    return nb::ndarray<nb::numpy, const float>(first, {surfaces.size(), SURFACE_FLOATS}, self);
}

void radiance(const Surfaces& surfaces, const Floats& origins, const Floats& directions, const FloatsOut& light,
              const FloatsOut& distances) {
    const int64_t count = length_of(distances, 0);
    const float* origin = checked(origins, "origins", {count, 3});
    const float* direction = checked(directions, "directions", {count, 3});
    float* out = checked(light, "light", {count, 4});
    float* distance = checked(distances, "distances", {ANY});
    nb::gil_scoped_release released;
    surfaces.radiance(origin, direction, count, out, distance);
}

Boxes boxes_of(const Doubles& corners) {
    const double* lows = checked(corners, "corners", {2, ANY, 3});
    const int count = count_of(corners.shape(1), "boxes", 1 << 28);  // face numbers are up to 6 times as large
    return {lows, lows + int64_t{3} * count, count};
}

BoxRays rays_of(const Doubles& origins, const Doubles& directions, int64_t count) {
    return {checked(origins, "origins", {count, 3}), checked(directions, "directions", {count, 3}), count};
}

void intersect_boxes_binding(const Doubles& corners, const Doubles& origins, const Doubles& directions,
                             const DoublesOut& distances, const IntsOut& faces) {
    const Boxes boxes = boxes_of(corners);
    require(boxes.count > 0, "corners must not be empty");
    double* distance = checked(distances, "distances", {ANY});
    const int64_t count = length_of(distances, 0);
    int32_t* face = checked(faces, "faces", {count});
    const BoxRays rays = rays_of(origins, directions, count);
    nb::gil_scoped_release released;
    intersect_boxes(boxes, rays, distance, face);
}

void are_blocked_binding(const Doubles& corners, const Doubles& origins, const Doubles& segments,
                         const BytesOut& blocked) {
    const Boxes boxes = boxes_of(corners);
    uint8_t* out = checked(blocked, "blocked", {ANY});
    const BoxRays rays = rays_of(origins, segments, length_of(blocked, 0));
    nb::gil_scoped_release released;
    are_blocked(boxes, rays, out);
}

}  // namespace

void add_surfaces(nb::module_& m) {
    nb::class_<Surfaces>(m, "Surfaces")
        .def(nb::new_(&make_surfaces), "records"_a, "sizes"_a, "texels"_a)
        .def_prop_ro("records", &records_of)
        .def("radiance", &radiance, "origins"_a, "directions"_a, "light"_a, "distances"_a);
    m.def("intersect_boxes", &intersect_boxes_binding, "corners"_a, "origins"_a, "directions"_a, "distances"_a,
          "faces"_a);
    m.def("are_blocked", &are_blocked_binding, "corners"_a, "origins"_a, "segments"_a, "blocked"_a);
}

}  // namespace omnimirror
