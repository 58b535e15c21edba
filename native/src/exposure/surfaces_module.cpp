// Textured surfaces as omnimirror.simulate.scenes.surfaces calls them.
#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "bindings.hpp"
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

Surfaces* make_surfaces(const Floats& places, const Floats& texture_coordinates, const Ints& kinds, const Ints& sizes,
                        const Floats& texels) {
    const size_t count = kinds.ndim() == 2 ? kinds.shape(0) : 0;
    require(kinds.ndim() == 2 && kinds.shape(1) == 2, "kinds are (n, 2): texture, triangle");
    require(places.size() == 9 * count && texture_coordinates.size() == 6 * count,
            "places are (n, 3, 3) and places on textures (n, 3, 2): corner and two sides");
    require(count < (1u << 27), "there are too many surfaces");
    const auto is_number = [](float x) { return std::fabs(x) < 1e15f; };
    require(std::all_of(places.data(), places.data() + places.size(), is_number) &&
                std::all_of(texture_coordinates.data(), texture_coordinates.data() + texture_coordinates.size(), is_number),
            "a place is no number, or too far away");
    std::vector<Texture> textures = textures_of(sizes, texels.size());
    std::vector<Surface> surfaces(count);
    for (size_t i = 0; i < count; ++i) {
        Surface& s = surfaces[i];
        const float *p = places.data() + 9 * i, *t = texture_coordinates.data() + 6 * i;
        std::copy_n(p, 3, s.corner), std::copy_n(p + 3, 6, &s.side[0][0]);
        std::copy_n(t, 2, s.texel), std::copy_n(t + 2, 4, &s.texel_side[0][0]);
        const int32_t texture = kinds.data()[2 * i];
        require(texture >= 0 && texture < static_cast<int32_t>(textures.size()), "there is no such texture");
        s.texture = texture, s.triangle = kinds.data()[2 * i + 1] != 0;
    }
    std::shared_ptr<const float> shared(texels.data(), [kept = texels](const float*) {});
    return new Surfaces(std::move(surfaces), std::move(textures), std::move(shared));
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

}  // namespace

void add_surfaces(nb::module_& m) {
    nb::class_<Surfaces>(m, "Surfaces")
        .def(nb::new_(&make_surfaces), "places"_a, "texture_coordinates"_a, "kinds"_a, "sizes"_a, "texels"_a)
        .def("radiance", &radiance, "origins"_a, "directions"_a, "light"_a, "distances"_a);
}

}  // namespace omnimirror
