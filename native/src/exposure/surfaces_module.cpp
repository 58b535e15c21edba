// Textured surfaces, and boxes, as omnimirror.simulate.scenes calls them.
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

std::vector<Texture> textures_of(const Ints& sizes, size_t texels) {
    require(sizes.ndim() == 2 && sizes.shape(1) == 3, "sizes are (textures, 3): width, height, repeats");
    std::vector<Texture> textures;
    int64_t first = 0;
    for (size_t i = 0; i < sizes.shape(0); ++i) {
        const int32_t* s = sizes.data() + 3 * i;
        require(s[0] > 0 && s[1] > 0 && s[0] < (1 << 24) && s[1] < (1 << 24), "a texture is empty or too large");
        textures.push_back({first, s[0], s[1], s[2]});
        first += int64_t{s[0]} * s[1];
    }
    require(4 * first == static_cast<int64_t>(texels), "the texels do not fit the textures' sizes");
    return textures;
}

Surfaces* make_surfaces(const Floats& records, const Ints& sizes, const Floats& texels) {
    require(records.ndim() == 2 && records.shape(1) == SURFACE_FLOATS, "records are (n, 16), as surfaces.hpp has them");
    const size_t count = records.shape(0);
    require(count < (1u << 27), "there are too many surfaces");
    std::vector<Surface> surfaces(count);
    if (count) std::memcpy(surfaces.data(), records.data(), count * sizeof(Surface));
    std::vector<Texture> textures = textures_of(sizes, texels.size());
    const auto are_numbers = [](const float* x, int many) {
        return std::all_of(x, x + many, [](float value) { return std::fabs(value) < 1e15f; });
    };
    for (const Surface& s : surfaces) {
        require(are_numbers(s.corner, 3) && are_numbers(&s.side[0][0], 6) && are_numbers(s.texel, 2) &&
                    are_numbers(&s.texel_side[0][0], 4),
                "a place is no number, or too far away");
        require(s.texture() < static_cast<int32_t>(textures.size()), "there is no such texture");
    }
    std::shared_ptr<const float> shared(texels.data(), [kept = texels](const float*) {});
    return new Surfaces(std::move(surfaces), std::move(textures), std::move(shared));
}

// As they were given, in the order of the tree and without those that have no width; of the same memory.
auto records_of(nb::handle self) {
    static const Surface none{};  // an array of nothing begins somewhere too
    const std::vector<Surface>& surfaces = nb::cast<const Surfaces&>(self).surfaces();
    const Surface* first = surfaces.empty() ? &none : surfaces.data();
    return nb::ndarray<nb::numpy, const float>(first, {surfaces.size(), SURFACE_FLOATS}, self);
}

void radiance(const Surfaces& surfaces, const Floats& origins, const Floats& directions, const FloatsOut& light,
              const FloatsOut& distances) {
    const int64_t count = static_cast<int64_t>(distances.size());
    require(static_cast<int64_t>(origins.size()) == 3 * count && static_cast<int64_t>(directions.size()) == 3 * count &&
                static_cast<int64_t>(light.size()) == 4 * count,
            "the arrays differ in size");
    nb::gil_scoped_release released;
    surfaces.radiance(origins.data(), directions.data(), count, light.data(), distances.data());
}

Boxes boxes_of(const Doubles& corners) {
    require(corners.ndim() == 3 && corners.shape(0) == 2 && corners.shape(2) == 3, "corners are (2, boxes, 3)");
    const size_t count = corners.shape(1);
    return {corners.data(), corners.data() + 3 * count, count_of(count)};
}

BoxRays rays_of(const Doubles& origins, const Doubles& directions, size_t count) {
    require(origins.size() == 3 * count && directions.size() == 3 * count, "the arrays differ in size");
    return {origins.data(), directions.data(), static_cast<int64_t>(count)};
}

void meet(const Doubles& corners, const Doubles& origins, const Doubles& directions, const DoublesOut& distances,
          const IntsOut& faces) {
    const Boxes boxes = boxes_of(corners);
    require(boxes.count > 0 && faces.size() == distances.size(), "there is no box, or the arrays differ in size");
    const BoxRays rays = rays_of(origins, directions, distances.size());
    nb::gil_scoped_release released;
    meet_boxes(boxes, rays, distances.data(), faces.data());
}

void lead_through(const Doubles& corners, const Doubles& origins, const Doubles& segments, const BytesOut& through) {
    const Boxes boxes = boxes_of(corners);
    const BoxRays ways = rays_of(origins, segments, through.size());
    nb::gil_scoped_release released;
    lead_through_boxes(boxes, ways, through.data());
}

}  // namespace

void add_surfaces(nb::module_& m) {
    nb::class_<Surfaces>(m, "Surfaces")
        .def(nb::new_(&make_surfaces), "records"_a, "sizes"_a, "texels"_a)
        .def_prop_ro("records", &records_of)
        .def("radiance", &radiance, "origins"_a, "directions"_a, "light"_a, "distances"_a);
    m.def("meet_boxes", &meet, "corners"_a, "origins"_a, "directions"_a, "distances"_a, "faces"_a);
    m.def("lead_through_boxes", &lead_through, "corners"_a, "origins"_a, "segments"_a, "through"_a);
}

}  // namespace omnimirror
